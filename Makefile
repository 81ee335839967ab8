# Two commands do everything: `make report` and `make test`.  Both need Python 3.11 or newer, nothing else.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
CAMPAIGN := data/replica/campaign.toml
OUT ?= out/replica

.PHONY: report test lint reports clean

report: $(VENV)/.installed
	$(BIN)/estim reanalyse $(CAMPAIGN) --out $(OUT)
	@echo "open $(OUT)/report.md"

test: $(VENV)/.installed
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto

# the rendered report that the repository shows; a test compares it with a new one
reports: $(VENV)/.installed
	$(BIN)/estim simulate data/replica/design.toml --out data/replica
	$(BIN)/estim reanalyse $(CAMPAIGN) --out reports/replica

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/mypy

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "estim needs Python 3.11 or newer: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,dev]'
	touch $@

clean:
	rm -rf $(VENV) out
