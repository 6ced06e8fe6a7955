# Needs make and Python 3.11 or later, nothing else. `make PYTHON=python3.12 test` picks another interpreter.
PYTHON ?= python3
WORKERS ?= 2
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
READY := $(VENV)/.installed
# Tests and studies run side by side already: threads of matrix products would only wait for each other.
export OPENBLAS_NUM_THREADS ?= 1
BENCH_READY := $(VENV)/.installed-bench

# The sample logs: those that need a column map live in a folder of their own and are not diagnosed here.
LOGS := $(sort $(wildcard data/*.csv.gz data/*.csv))
# The pipelines whose reports are committed; those of recorded data only where they are.
STUDIES := $(addprefix pipelines.,reproduce_paper compare_mixture diagnose_study identify_study freed_study improve_study severity_study logger_study plan_study)
STUDIES += $(if $(OBSERVER_FI_DATA),pipelines.identify_emps pipelines.improve_emps)
BENCHMARKS := $(sort $(wildcard benchmarks/bench_*.py))

.PHONY: help install demo test slow studies lint check bench report wheel docs clean

help:
	@echo "make demo    diagnose the sample logs of data/"
	@echo "make test    the tests, without the slow studies"
	@echo "make slow    the slow studies (Monte Carlo) that CI has time for"
	@echo "make studies the other ones, some hours on two cores"
	@echo "make lint    format, lint, types, import contract"
	@echo "make check   lint and test"
	@echo "make bench   speed and memory against peers"
	@echo "make report  write the committed reports anew (hours: every study, many seeds)"
	@echo "make docs    the pages of docs/ and reports/ as a site, in build/site/"
	@echo "make wheel   build the sdist and the wheel into dist/"
	@echo "make clean   remove the environment and everything built"

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "observer-fi needs Python 3.11 or later, not " + sys.version.split()[0] + ": make PYTHON=python3.x")'
	@echo "Installing into $(VENV) (about a minute, once)"
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv $(VENV)
	@$(PIP) install --quiet -c constraints.txt -e '.[dev]'
	@touch $@

$(BENCH_READY): $(READY)
	@$(PIP) install --quiet -c constraints.txt -e '.[bench]'
	@touch $@

install: $(READY)

demo: $(READY)
	$(BIN)/observer-fi diagnose $(LOGS) --out reports/demo
	@echo "The reports are in reports/demo/, one folder a log; open these in a browser:"
	@ls -1 reports/demo/*/report.html

test: $(READY)
	$(BIN)/python -m pytest -q -n $(WORKERS)

# pytest exits with 5 where no test is marked slow.
slow: $(READY)
	$(BIN)/python -m pytest -q -n $(WORKERS) -m "slow and not study" --durations=40 || [ $$? -eq 5 ]

studies: $(READY)
	$(BIN)/python -m pytest -q -n $(WORKERS) -m study --durations=40

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint test

bench: $(BENCH_READY)
	@set -e; for script in $(BENCHMARKS); do echo "$$script"; $(BIN)/python $$script; done

report: $(READY)
	@set -e; for study in $(STUDIES); do echo "$$study"; $(BIN)/python -m $$study; done

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "The site is in build/site/: open build/site/index.html in a browser"

wheel: $(READY)
	rm -rf dist
	$(BIN)/python -m build --outdir dist

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
