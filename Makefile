# Two commands matter: `make run` and `make test`. Both set up all they need in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.DEFAULT_GOAL := help

.PHONY: help
help:  ## Say what can be made
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

.PHONY: run
run: $(VENV)/.run  ## Start a simulated three-axis module and the service; Ctrl-C stops both
	@exec $(BIN)/canaxis demo

.PHONY: test
test: $(VENV)/.dev  ## Pass every test
	$(BIN)/pytest -n 2

.PHONY: lint
lint: $(VENV)/.dev  ## Style, types, import rules
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

.PHONY: openapi
openapi: $(VENV)/.dev  ## Write openapi/openapi.json anew from the service
	$(BIN)/canaxis openapi --output openapi/openapi.json

.PHONY: eds
eds: $(VENV)/.dev  ## Write the module's EDS anew from its object dictionary
	$(BIN)/python -m drivers.devices.eds

.PHONY: drift
drift: $(VENV)/.dev  ## Fail if a committed generated file differs from what its source makes now
	$(BIN)/canaxis openapi | diff -u openapi/openapi.json -
	$(BIN)/canaxis eds print | diff -u drivers/devices/data/tmcm_3216.eds -

.PHONY: bench
bench: $(VENV)/.dev  ## Measure what simulated modules cost, idle and turning
	$(BIN)/python bench/simulated_modules.py

.PHONY: format
format: $(VENV)/.dev  ## Put the source into the house's format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

.PHONY: lock
lock: $(VENV)/.dev  ## Resolve the dependencies anew, with hashes (needs `uv`)
	uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--no-emit-index-url --extra build -o requirements.lock pyproject.toml
	uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--no-emit-index-url --extra build --extra dev -o requirements-dev.lock pyproject.toml

.PHONY: clean
clean:  ## Remove what was set up
	rm -rf $(VENV) .ruff_cache .hypothesis .import_linter_cache

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "canaxis needs Python 3.11 or newer; try: make PYTHON=python3.12 $(MAKECMDGOALS)")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: requirements.lock pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

$(VENV)/.dev: requirements-dev.lock pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-dev.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@ $(VENV)/.run
