# Every target does its own set-up in .venv. Another Python: make PYTHON=python3.13 test
PYTHON ?= python3
BIN := .venv/bin
NATIVE := haptigraph/perception/native
SANITIZED := build/sanitized
SCENES ?= $(basename $(notdir $(wildcard rendering/scenes/*.toml)))

.PHONY: setup demo live test test-slow test-native fuzz check bench bench-live bench-oct bench-touch bench-sweep compare-touch rehearse screenshots soak golden train render interop lock clean

setup: .venv/ready

.venv/locked: requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "haptigraph needs Python 3.11 or newer; try: make PYTHON=python3.11 setup")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	@touch .venv/locked

# Depends on the folder too, for a source that is removed. Installs Zig where no C compiler works.
.venv/ready: .venv/locked pyproject.toml hatch_build.py $(NATIVE) $(wildcard $(NATIVE)/*.[ch])
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $$($(BIN)/python -c 'import hatchling.build; print(*hatchling.build.get_requires_for_build_editable())')
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch .venv/ready

demo: setup  ## half a minute of the whole loop, simulated; writes a recording and a picture
	$(BIN)/haptigraph demo

live: setup  ## steer a simulated needle from a page in the browser, and feel it
	$(BIN)/haptigraph live

test: setup  ## all tests; those in the browser where Chromium is installed, one after the other
	$(BIN)/python -m pytest -n auto --dist loadgroup

test-slow: setup  ## the long suites: thousands of broken procedures, and the like
	$(BIN)/python -m pytest -m slow

fuzz: setup  ## the property tests on thousands of new examples
	$(BIN)/python -m pytest -n auto -m hypothesis --hypothesis-profile=fuzz

test-native: setup  ## the tests of perception on a copy whose C runs under sanitizers; needs gcc, Linux
	rm -rf $(SANITIZED) && mkdir -p $(SANITIZED) && cp -R haptigraph $(SANITIZED)
	CC=gcc $(BIN)/python hatch_build.py $(SANITIZED)/$(NATIVE)/native.library -g -fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all
	LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libstdc++.so.6)" ASAN_OPTIONS=detect_leaks=0 \
		$(BIN)/python -m pytest -n auto -s -o pythonpath="$(SANITIZED) . tests/support" tests/perception

check: setup  ## format, lint, types, layers, warnings of the C compiler
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/clang-format --dry-run --Werror $(NATIVE)/*.[ch]
	$(BIN)/mypy
	$(BIN)/lint-imports
	mkdir -p build && $(BIN)/python hatch_build.py build/strict.library -Wall -Wextra -Werror

bench: setup  ## time of every stage; perceivers against the paper's; rules against NetworkX and CLIPS
	$(BIN)/python benchmarks/loop.py
	$(BIN)/python benchmarks/perception.py
	$(BIN)/python benchmarks/bscan.py speed
	$(BIN)/python benchmarks/bscan.py speed --perceiver segmentation
	$(BIN)/python benchmarks/inference.py
	$(BIN)/python benchmarks/chatter.py

bench-live: setup  ## latency through a browser, load of viewers, memory of a page left open; needs Chromium
	$(BIN)/python benchmarks/live.py latency
	$(BIN)/python benchmarks/live.py load
	$(BIN)/python benchmarks/live.py memory

bench-touch: setup  ## how well a board on a serial port keeps the haptic grammar's time
	$(BIN)/python benchmarks/touch.py

bench-sweep: setup  ## 1,000 simulated participants on a local Dask cluster, two workers against one
	$(BIN)/python benchmarks/sweep.py

compare-touch: setup  ## simulated operators without touch, with binary and continuous touch; renews docs/simulated_comparison.md
	$(BIN)/python benchmarks/touch_comparison.py
	$(BIN)/python benchmarks/touch_comparison.py --vary --repetitions 1

bench-oct: setup  ## errors of the perceiver of B-scans, and the alarm's lead in 1,000 simulated approaches
	$(BIN)/python benchmarks/bscan.py sweep 20 --figure docs/images/bscan_accuracy.png
	$(BIN)/python benchmarks/bscan_approaches.py --figure docs/images/bscan_lead.png

rehearse: setup  ## two whole studies with simulated participants; renews docs/images/study-*.png and docs/simulated_comparison.md
	$(BIN)/python docs/study_pictures.py

screenshots: setup  ## pictures of every page into docs/images; needs Chromium
	$(BIN)/python docs/screenshots.py

train: setup  ## learn the network of the perceiver segmentation anew, on simulated B-scans, and write its report
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement training/requirements.txt
	$(BIN)/python -m training.train

.venv-rendering/ready: rendering/requirements.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11) and f"Blender needs CPython 3.11, found {sys.version.split()[0]}; try: make PYTHON=python3.11 render")'
	$(PYTHON) -m venv .venv-rendering
	.venv-rendering/bin/python -m pip install --quiet --disable-pip-version-check --requirement rendering/requirements.txt
	@touch .venv-rendering/ready

render: setup .venv-rendering/ready  ## labelled clips of rendered scenes into build/renderings; a quarter of an hour for each of SCENES
	@for scene in $(SCENES); do \
		.venv-rendering/bin/python -m rendering.render $$scene && $(BIN)/python -m rendering.pack $$scene || exit 1; \
	done

soak: setup  ## memory over 100,000 steps, then eight hours with random faults; takes hours
	$(BIN)/python benchmarks/memory.py
	$(BIN)/python benchmarks/soak.py

golden: setup  ## record the golden runs anew; read what changed before committing
	$(BIN)/python tests/replay/make_golden.py

interop: setup  ## real ROS 2 nodes (Jazzy, Kilted) in environments of their own, and pyigtl; needs a C compiler
	for ros in jazzy kilted; do \
		test -x .interop/$$ros/bin/python || $(PYTHON) -m venv .interop/$$ros; \
		.interop/$$ros/bin/python -m pip install --quiet --disable-pip-version-check --requirement tests/interop/$$ros.txt || exit 1; \
	done
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'pyigtl>=0.3.1,<1'
	$(BIN)/python -m pytest -m slow tests/interop
	$(BIN)/python -m pytest tests/bridges

lock: setup  ## resolve the dependencies anew
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/uv pip compile pyproject.toml --all-extras --group dev --universal --python-version 3.11 --generate-hashes --no-header --output-file requirements.lock

clean:
	rm -f $(NATIVE)/native.library
	rm -rf .venv .venv-rendering .interop dist build .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
