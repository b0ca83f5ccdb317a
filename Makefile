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
test: $(VENV)/.dev  ## Pass every test but the long ones
	$(BIN)/pytest -n 4 --dist worksteal

.PHONY: test-slow
test-slow: $(VENV)/.dev  ## Pass the long tests that `make test` leaves out
	$(BIN)/pytest -n 4 --dist worksteal -m slow

.PHONY: installed
installed: $(VENV)/.dev  ## Install the wheel in empty environments, follow the Dockerfile, try what is there
	$(BIN)/pytest -n 2 --dist loadgroup -m installed tests/deploy

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

.PHONY: client
client: $(VENV)/.dev  ## Write the blocking client, canaxis/blocking, anew from the asynchronous one
	$(BIN)/python tools/blocking.py

.PHONY: drift
drift: $(VENV)/.dev  ## Fail if a committed generated file differs from what its source makes now
	$(BIN)/canaxis openapi | diff -u openapi/openapi.json -
	$(BIN)/canaxis eds print | diff -u drivers/devices/data/tmcm_3216.eds -
	$(BIN)/python tools/blocking.py --check

.PHONY: bench
bench: $(VENV)/.dev  ## Measure the speed beside canopen's and canopen-asyncio's (see docs/benchmarks.md)
	$(BIN)/python -m bench

TARGET ?= all
SECONDS ?= 60

SEEDS ?= 5000
FROM ?= 0
PROCESSES ?= 2

.PHONY: soak
soak: $(VENV)/.dev  ## Play seeds of simulated trouble: SEEDS=5000 FROM=0 PROCESSES=2, or one alone: SEED=12345
	$(BIN)/python tests/seeds $(if $(SEED),--seed $(SEED),--seeds $(SEEDS) --from $(FROM) --processes $(PROCESSES))

COMMANDS ?= 10000

.PHONY: judge
judge: $(VENV)/.dev  ## Random commands of four clients over three SIGKILLs: each once, ended, none lost: COMMANDS=10000
	PYTHONPATH=. $(BIN)/python tests/judge --commands $(COMMANDS)

MINUTES ?= 10

.PHONY: mutants
mutants: $(VENV)/.dev  ## Plant faults where motors are moved, print those that no test finds: MINUTES=10 SEED= FILES= JOBS= MUTANT=
	$(BIN)/python tests/mutants --minutes $(MINUTES) $(if $(SEED),--seed $(SEED)) $(if $(JOBS),--jobs $(JOBS)) $(if $(FILES),--files $(foreach file,$(FILES),'$(file)')) $(if $(MUTANT),--mutant $(MUTANT))

.PHONY: fuzz
fuzz: $(VENV)/.fuzz  ## Fuzz the decoders, guided by coverage: TARGET=name SECONDS=60 (each)
	$(BIN)/python -m tests.fuzz $(TARGET) --seconds $(SECONDS)

.PHONY: format
format: $(VENV)/.dev  ## Put the source into the house's format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

.PHONY: lock
lock: $(VENV)/.dev  ## Resolve the dependencies anew, with hashes (needs `uv`)
	uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--no-emit-index-url --extra server --extra build -o requirements.lock pyproject.toml
	uv pip compile -q --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--no-emit-index-url --extra server --extra build --extra dev -o requirements-dev.lock pyproject.toml
	echo 'atheris==3.0.0' | uv pip compile -q --universal --python-version 3.11 --generate-hashes \
		--no-annotate --no-header --no-emit-index-url -o requirements-fuzz.lock -

.PHONY: audit
audit: requirements.lock  ## Ask PyPI for known vulnerabilities of the locked dependencies (needs pypi.org)
	$(PYTHON) -m venv $(VENV)/audit
	$(VENV)/audit/bin/pip install --quiet --disable-pip-version-check pip-audit
	$(VENV)/audit/bin/pip-audit --strict --disable-pip --require-hashes -r requirements.lock

.PHONY: clean
clean:  ## Remove what was set up
	rm -rf $(VENV) .fuzz .mutants .ruff_cache .hypothesis .import_linter_cache

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

$(VENV)/.fuzz: requirements-fuzz.lock $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements-fuzz.lock
	@touch $@
