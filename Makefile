# Every target does its own set-up in .venv. Another Python: make PYTHON=python3.13 VENV=.venv-3.13 test
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
TESTS ?=
OTHER_PYTHONS ?= 3.12 3.13
NATIVE := haptigraph/perception/native
SANITIZED := build/sanitized
WORKERS ?= 2  # of each half of the tests
PYTEST = $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile
# uv takes a tenth of pip's time; pip also reads pip's own settings, for instance of a mirror.
INSTALL = UV_SYSTEM_CERTS=1 $(BIN)/python -m uv pip install --python $(BIN)/python --requirement $(1) || \
	$(BIN)/python -m pip install --disable-pip-version-check --requirement $(1)
export PYTHONDONTWRITEBYTECODE =  # programs start faster from compiled modules, and most packages are never imported
RIG ?= rig/d405.toml
RIGS ?= $(basename $(notdir $(wildcard rig/*.toml)))
BUILDS ?= 2
PAGES ?= docs
SCENES ?= $(basename $(notdir $(wildcard rendering/scenes/*.toml)))

.PHONY: help docs docs-snippets docs-site setup demo live test test-cache test-pythons test-slow test-native mutants procedure-mutants fuzz check check-types check-others bench bench-degraded bench-certainty bench-empty bench-rig ablation bench-force bench-force-loop bench-live bench-oct bench-robot bench-volumes bench-silence bench-touch bench-archive bench-profiles bench-sweep interval-coverage compare-r compare-touch rehearse screenshots faults soak golden train train-tip render render-tips render-unseen rig test-rig rig-registration interop test-exports wheels lock clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-16s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(VENV)/ready  ## .venv with everything, from the lock file

# What `live` and `demo` need; the rest comes with `locked`.
$(VENV)/base: requirements-base.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "haptigraph needs Python 3.11 or newer; try: make PYTHON=python3.11 setup")'
	@echo "haptigraph: installing $$(grep -c '==' requirements-base.lock) packages into $(VENV), once"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'uv>=0.11,<1' || true
	$(call INSTALL,requirements-base.lock)
	@touch $(VENV)/base

# The folder too, because a source may be removed. Zig if no C compiler works.
$(VENV)/runs: $(VENV)/base pyproject.toml hatch_build.py $(NATIVE) $(wildcard $(NATIVE)/*.[ch] $(NATIVE)/*/*.[ch])
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $$($(BIN)/python -c 'import hatchling.build; print(*hatchling.build.get_requires_for_build_editable())')
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $(VENV)/runs

$(VENV)/locked: requirements.lock $(VENV)/base
	@echo "haptigraph: installing $$(grep -c '==' requirements.lock) packages into $(VENV) for tests and all extras, once"
	$(call INSTALL,requirements.lock)
	@touch $(VENV)/locked

$(VENV)/ready: $(VENV)/locked $(VENV)/runs
	@touch $(VENV)/ready

demo: $(VENV)/runs  ## the whole loop on a simulated eye, half a minute; writes a recording and a figure
	$(BIN)/haptigraph demo

live: $(VENV)/runs  ## steer a simulated needle from a page in the browser, with haptic feedback
	$(BIN)/haptigraph live

test: setup  ## all tests, or TESTS=...; those of the pages need Chromium
	@mkdir -p build; echo "tests in real time run meanwhile; their results come last"; \
	$(PYTEST) -m "realtime and not slow" $(TESTS) >build/realtime.log 2>&1 & realtime=$$!; \
	nice -n 19 $(PYTEST) -m "not realtime and not slow" $(TESTS); others=$$?; \
	wait $$realtime; realtime=$$?; cat build/realtime.log; \
	case "$$realtime $$others" in "0 0" | "0 5" | "5 0") ;; *) exit 1 ;; esac  # 5: TESTS selects none

test-cache: setup  # compiles tests and what they import once; else each worker of `make test` does it for itself
	$(BIN)/python -m pytest --collect-only --quiet >/dev/null || echo "some tests cannot be collected: make test says why"

test-pythons:  ## all tests, or TESTS=..., on OTHER_PYTHONS (on PATH or from pyenv), each in an environment of its own
	@tested= missing= failed=; for version in $(OTHER_PYTHONS); do \
		for python in python$$version $$HOME/.pyenv/versions/$$version.*/bin/python none; do \
			test $$python = none || ! $$python -c "import venv" 2>/dev/null || break; \
		done; \
		if test $$python = none; then missing="$$missing $$version"; continue; fi; \
		echo "== Python $$version: $$python"; tested="$$tested $$version"; \
		$(MAKE) --no-print-directory PYTHON=$$python VENV=.venv-$$version test || failed="$$failed $$version"; \
	done; \
	echo "== tested on Python:$${tested:- none}; failed:$${failed:- none}; not found, so not tested:$${missing:- none}"; \
	test -z "$$failed"

test-slow: setup  ## the long suites, for instance thousands of mutated procedures
	$(BIN)/python -m pytest -m slow

mutants: setup  ## break the core on purpose, operator by operator: a test must fail, or tests/survivors.toml say why not
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'mutmut>=3.8,<4'
	$(BIN)/python tests/mutants.py

procedure-mutants: setup  ## every number and order of the shipped procedures changed once: what check finds, and why not the rest
	PYTHONPATH=tests/proof $(BIN)/python tests/proof/procedure_mutants.py

fuzz: setup  ## the property tests on thousands of new examples
	$(BIN)/python -m pytest -n auto -m hypothesis --hypothesis-profile=fuzz

test-native: setup  ## the tests of perception with the address and undefined-behaviour sanitizers; needs gcc, Linux
	rm -rf $(SANITIZED) && mkdir -p $(SANITIZED) && cp -R haptigraph $(SANITIZED)
	CC=gcc $(BIN)/python hatch_build.py $(SANITIZED)/$(NATIVE)/native.library -g -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all
	LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libstdc++.so.6)" ASAN_OPTIONS=detect_leaks=0 \
		$(BIN)/python -m pytest -n auto -s -o pythonpath="$(SANITIZED) $$($(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["tool"]["pytest"]["ini_options"]["pythonpath"])')" tests/perception

# npm and Node come from a wheel in .venv; Node's own programs expect it in PATH.
node_modules/ready: .venv/locked package.json package-lock.json
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/npm ci --ignore-scripts --no-audit --no-fund --loglevel error || { \
		echo "make check needs TypeScript and ESLint: npm could not install them (see above); check the connection to the npm registry" >&2; exit 1; }
	@touch node_modules/ready

check: check-types check-others  ## format, lint, types, layers, JavaScript, warnings of the C compiler

check-types: setup  # takes longer than all others: make --jobs 2 check
	$(BIN)/mypy

check-others: setup node_modules/ready
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/clang-format --dry-run --Werror $(NATIVE)/*.[ch] $(NATIVE)/*/*.[ch]
	$(BIN)/lint-imports
	$(BIN)/python docs/words.py
	$(BIN)/node node_modules/typescript/bin/tsc
	$(BIN)/node node_modules/eslint/bin/eslint.js
	mkdir -p build && $(BIN)/python hatch_build.py build/strict.library -Wall -Wextra -Werror

bench: setup  ## time of every stage; perceivers against the paper's; rules against NetworkX and CLIPS
	$(BIN)/python benchmarks/loop.py
	$(BIN)/python benchmarks/perception.py
	$(BIN)/python benchmarks/bscan.py speed
	$(BIN)/python benchmarks/bscan.py speed --perceiver segmentation
	$(BIN)/python benchmarks/inference.py
	$(BIN)/python benchmarks/chatter.py

bench-certainty: setup  ## whether tips are as often far as they say, in drawn scenes that the network has not learned
	$(BIN)/python -m training.tip_reliability --figure build/tip_reliability.png

bench-empty: setup  ## how often a needle is reported in pictures that show none
	$(BIN)/python benchmarks/no_needle.py

bench-rig: setup  ## how surely rig check finds sabotaged rigs, and how often something in sound ones; 15 min
	$(BIN)/python benchmarks/rig_check.py

bench-degraded: setup  ## accuracy on labelled clips: as they are, at half size, with motion blur, noise, and as poor JPEG
	$(BIN)/python benchmarks/degraded.py

ablation: setup  ## what each constant of tip and line is good for: doubled once, zero once; a quarter of an hour
	$(BIN)/python benchmarks/ablation.py tests/data/renderings

bench-live: $(VENV)/runs  ## latency through a browser, load of viewers, memory of an open page; needs Chromium
	$(BIN)/python benchmarks/live.py latency
	$(BIN)/python benchmarks/live.py load
	$(BIN)/python benchmarks/live.py memory

bench-silence: setup  ## how soon a device is silent after each fault of a real run; needs a machine without other work
	mkdir -p build && HAPTIGRAPH_FAULTS=build/silence.jsonl $(BIN)/python -m pytest tests/faults/test_faults.py tests/faults/devices tests/faults/test_ros2_faults.py tests/faults/test_lost_camera.py

bench-force: setup  ## force feedback: energy of random motions, limits, releases, stiffness, saboteurs; 30 min
	$(BIN)/python benchmarks/force.py

bench-robot: setup  ## a robot's loop: distance from the RCM, holds after faults, jitter at 200 Hz
	$(BIN)/python benchmarks/robot_approaches.py
	$(BIN)/python benchmarks/robot_loop.py

bench-force-loop: setup  ## the loop of a force device: jitter at 1 kHz
	$(BIN)/python benchmarks/force_loop.py

bench-touch: setup  ## timing accuracy of the haptic grammar on a board at a serial port
	$(BIN)/python benchmarks/touch.py
	$(BIN)/python benchmarks/touch.py --device drv2605

bench-profiles: setup  ## simulated persons calibrate simulated devices: coverage, and whether "low" is the same
	$(BIN)/python benchmarks/device_profiles.py

bench-archive: setup  ## 2,000 recordings: index, queries, batches in processes and on a local Dask cluster; half an hour
	$(BIN)/python benchmarks/archive.py
	$(BIN)/python benchmarks/archive.py simulated --count 0

bench-sweep: setup  ## 1,000 simulated participants on a local Dask cluster, two workers against one
	$(BIN)/python benchmarks/sweep.py

interval-coverage: setup  ## coverage of a study report's intervals by simulation; updates docs/explanation/study_report.md; some minutes
	$(BIN)/python benchmarks/interval_coverage.py

compare-r: setup  ## rank tests, estimates and hit rates on random data sets against R; needs Rscript with coin and exactRankTests
	$(BIN)/python benchmarks/r_comparison.py

compare-touch: setup  ## simulated operators without and with vibration and force; updates docs/explanation/simulated_comparison.md; half an hour
	$(BIN)/python benchmarks/touch_comparison.py
	$(BIN)/python benchmarks/touch_comparison.py --forces
	$(BIN)/python benchmarks/touch_comparison.py --vary --repetitions 1

bench-oct: setup  ## errors of the B-scan perceiver, and the lead time of the alarm in 1,000 simulated approaches
	$(BIN)/python benchmarks/bscan.py sweep 60 --figure docs/images/bscan_accuracy.png
	$(BIN)/python benchmarks/bscan_approaches.py --figure docs/images/bscan_lead.png

bench-volumes: setup  ## errors in simulated OCT volumes, and the lead time of the alarm in 1,000 approaches at 4 volumes/s
	$(BIN)/python benchmarks/volume.py speed
	$(BIN)/python benchmarks/volume.py accuracy
	$(BIN)/python benchmarks/volume_approaches.py --figure docs/images/volume_lead.png

rehearse: setup  ## two complete studies with simulated participants; updates docs/images/study-*.png and docs/explanation/simulated_comparison.md
	$(BIN)/python docs/study_pictures.py

screenshots: setup  ## screenshots of every page into docs/images; needs Chromium
	$(BIN)/python docs/screenshots.py

$(VENV)/training: $(VENV)/ready requirements-training.lock
	$(call INSTALL,requirements-training.lock)
	@touch $(VENV)/training

train: $(VENV)/training  ## train the networks of the perceiver segmentation on simulated B-scans, and write its report
	OMP_WAIT_POLICY=passive GOMP_SPINCOUNT=0 $(BIN)/python -m training.train

train-tip: $(VENV)/training  ## train the network that finds a needle's tip, on simulated scenes and on what make render-tips rendered
	OMP_WAIT_POLICY=passive GOMP_SPINCOUNT=0 $(BIN)/python -m training.train_tip

.venv-rendering/ready: rendering/requirements.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11) and f"Blender needs CPython 3.11, found {sys.version.split()[0]}; try: make PYTHON=python3.11 render")'
	$(PYTHON) -m venv .venv-rendering
	.venv-rendering/bin/python -m pip install --quiet --disable-pip-version-check --requirement rendering/requirements.txt
	@touch .venv-rendering/ready

render: setup .venv-rendering/ready  ## labelled clips of rendered scenes into build/renderings; 15 minutes for each of SCENES
	@for scene in $(SCENES); do \
		.venv-rendering/bin/python -m rendering.render $$scene && $(BIN)/python -m rendering.pack $$scene || exit 1; \
	done

render-tips: .venv-rendering/ready  ## tips of needles in scenes drawn by lot into build/tips, for make train-tip; 40 minutes
	.venv-rendering/bin/python -m rendering.render_tips

render-unseen: .venv-rendering/ready  ## the same of scenes that the network does not learn from, for make bench-certainty; 20 minutes
	.venv-rendering/bin/python -m rendering.render_tips --unseen

.venv-rig/ready: rig/requirements.txt
	$(PYTHON) -m venv .venv-rig
	.venv-rig/bin/python -m pip install --quiet --disable-pip-version-check --requirement rig/requirements.txt
	@touch .venv-rig/ready

rig: .venv-rig/ready  ## CAD of RIG (rig/d405.toml) into build/rig: STEP, STL, drawings, bill of materials, checks; 1.7 GB once
	.venv-rig/bin/python -m rig.build $(RIG) $(if $(PICTURES),--pictures)

test-rig: .venv-rig/ready  ## tests of the CAD: every shipped rig builds, and every check finds its sabotage; some minutes
	.venv-rig/bin/python -m pytest --confcutdir=tests/rig_cad tests/rig_cad

rig-registration: setup .venv-rendering/ready  ## ray-traced pictures of the meshes of `make rig`, as designed and BUILDS as built, registered; 10 min each
	@for rig in $(RIGS); do \
		.venv-rendering/bin/python -m rendering.rigs.render rig/$$rig.toml build/rig/$$rig/meshes build/rig-pictures/$$rig $(BUILDS) || exit 1; \
	done
	PYTHONPATH=. $(BIN)/python benchmarks/rig_registration.py build/rig-pictures

faults: setup  ## 1,930 random faults against the real program, 55 minutes a call; goes on where it stopped (build/faults.jsonl)
	mkdir -p build && PYTHONPATH=.:tests/support:tests/support/boards:tests/support/force:tests/dashboard:tests/faults:tests/faults/devices:tests/faults/force $(BIN)/python tests/faults/campaign.py --results build/faults.jsonl

soak: setup  ## memory over 100,000 steps, then eight hours of random faults; takes hours
	$(BIN)/python benchmarks/memory.py
	$(BIN)/python benchmarks/soak.py

golden: setup  ## record the golden runs again; review the changes before committing
	$(BIN)/python tests/replay/make_golden.py

interop: setup  ## real ROS 2 nodes (Jazzy, Kilted) in separate environments, and pyigtl; needs a C++ compiler
	for ros in jazzy kilted; do \
		test -x .interop/$$ros/bin/python || $(PYTHON) -m venv .interop/$$ros; \
		.interop/$$ros/bin/python -m pip install --quiet --disable-pip-version-check --requirement tests/interop/$$ros.txt || exit 1; \
		test -d .interop/$$ros/lib/python3*/site-packages/crtk_msgs || .interop/$$ros/bin/python tests/interop/generate_msgs.py tests/interop/msgs || exit 1; \
	done
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'pyigtl>=0.3.1,<1'
	$(BIN)/python -m pytest -m slow tests/interop
	$(BIN)/python -m pytest tests/bridges

docs: docs-snippets docs-site  ## the site into build/docs: every command of every page is run first; warnings are errors

docs-snippets: $(VENV)/docs  ## run the commands and programs of all pages, or of PAGES=docs/how_to/devices.md
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile $(PAGES)

docs-site: $(VENV)/docs  # with its notebooks and gallery
	rm -rf build/docs
	$(BIN)/python -m sphinx --builder html --fail-on-warning --keep-going --quiet --doctree-dir build/doctrees docs build/docs
	$(BIN)/python docs/outside.py build/docs --browser

$(VENV)/docs: $(VENV)/ready requirements-docs.lock
	$(call INSTALL,requirements-docs.lock)
	@touch $(VENV)/docs

wheels: .venv-release/ready  ## an sdist, and wheels for Linux, macOS and Windows, into dist/, checked and tried; needs qemu-user, libc6-arm64-cross, musl (also arm64), wine64
	.venv-release/bin/python -m release.wheels

.venv-release/ready: release/requirements.txt
	$(PYTHON) -m venv --clear .venv-release
	.venv-release/bin/python -m pip install --quiet --disable-pip-version-check -r release/requirements.txt
	@touch $@

test-exports: setup  ## exports read by the libraries of LeRobot (CPython 3.11, 3.12) and Rerun; downloads 6 GB once
	@missing=; for requirements in tests/exports/*.txt; do \
		name=$$(basename $$requirements .txt); version=$${name##*-}; environment=.exports/$$name; \
		for python in python$$version $$HOME/.pyenv/versions/$$version.*/bin/python none; do \
			test $$python = none || ! $$python -c "import venv" 2>/dev/null || break; \
		done; \
		if test $$python = none; then missing="$$missing $$name"; continue; fi; \
		test -x $$environment/bin/python || $$python -m venv $$environment || exit 1; \
		UV_SYSTEM_CERTS=1 $(BIN)/python -m uv pip install --python $$environment/bin/python --requirement $$requirements || \
			$$environment/bin/python -m pip install --quiet --disable-pip-version-check --requirement $$requirements || exit 1; \
	done; \
	$(BIN)/python -m pytest -m slow -rs tests/exports && $(BIN)/python -m pytest tests/analysis/exporting || exit 1; \
	echo "== without Python, so not tested:$${missing:- none}"

COMPILE = $(BIN)/uv pip compile pyproject.toml --universal --python-version 3.11 --generate-hashes --no-header

lock: setup  ## resolve the dependencies again
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'uv>=0.11,<1'
	$(COMPILE) --all-extras --group dev --output-file requirements.lock
	$(COMPILE) --extra figures --group build --constraint requirements.lock --output-file requirements-base.lock
	$(COMPILE) --group docs --constraint requirements.lock --output-file requirements-docs.lock
	$(COMPILE) --extra onnx --group training --constraint requirements.lock --output-file requirements-training.lock

clean:  ## remove all that make has made, environments included
	rm -f $(NATIVE)/native.library
	rm -rf .venv .venv-* .exports .interop node_modules mutants dist build .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
