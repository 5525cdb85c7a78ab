# Every target does its own set-up in .venv. Another Python: make PYTHON=python3.13 test
PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup demo live test fuzz check bench bench-live screenshots soak golden lock clean

setup: .venv/ready

.venv/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "haptigraph needs Python 3.11 or newer; try: make PYTHON=python3.11 setup")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch .venv/ready

demo: setup  ## half a minute of the whole loop, simulated; writes a recording and a picture
	$(BIN)/haptigraph demo

live: setup  ## steer a simulated needle from a page in the browser, and feel it
	$(BIN)/haptigraph live

test: setup  ## all tests; those in the browser where Chromium is installed, one after the other
	$(BIN)/python -m pytest -n auto --dist loadgroup

fuzz: setup  ## the property tests on thousands of new examples
	$(BIN)/python -m pytest -n auto -m hypothesis --hypothesis-profile=fuzz

check: setup  ## format, lint, types, layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup  ## steps/s and the time of every stage; perceivers against the paper's pipeline
	$(BIN)/python benchmarks/loop.py
	$(BIN)/python benchmarks/perception.py

bench-live: setup  ## latency through a browser, load of viewers, memory of a page left open; needs Chromium
	$(BIN)/python benchmarks/live.py latency
	$(BIN)/python benchmarks/live.py load
	$(BIN)/python benchmarks/live.py memory

screenshots: setup  ## pictures of every page into docs/images; needs Chromium
	$(BIN)/python docs/screenshots.py

soak: setup  ## memory over 100,000 steps; takes about an hour
	$(BIN)/python benchmarks/memory.py

golden: setup  ## record the golden runs anew; read what changed before committing
	$(BIN)/python tests/replay/make_golden.py

lock: setup  ## resolve the dependencies anew
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/uv pip compile pyproject.toml --all-extras --group dev --universal --python-version 3.11 --generate-hashes --no-header --output-file requirements.lock

clean:
	rm -rf .venv dist build .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
