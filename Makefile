# Two commands do everything: `make report` and `make test`.  Both need Python 3.11 or newer, nothing else.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
CAMPAIGN := data/replica/campaign.toml
OUT ?= out/replica

.PHONY: report test test-long lint reports gallery bench coverage docs site lock clean

report: $(VENV)/.installed
	$(BIN)/estim reanalyse $(CAMPAIGN) --out $(OUT)
	@echo "open $(OUT)/report.md"

# PYTHONDONTWRITEBYTECODE, where it is set, has every worker rewrite all tests and every process that they start compile all modules
test: $(VENV)/.installed
	PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal -m "not slow and not statistics"

# the others: tests of more than two seconds, and studies by repeated sampling (coverage of intervals, p-values of the tests, simulation-based calibration)
test-long: $(VENV)/.installed
	PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal -m "slow or statistics"

# the rendered report that the repository shows; a test compares it with a new one
reports: $(VENV)/.installed
	$(BIN)/estim simulate data/replica/design.toml --out data/replica
	$(BIN)/estim reanalyse $(CAMPAIGN) --figures all --out reports/replica

# real experiments with published results: reports/gallery, in about two minutes
gallery: $(VENV)/.installed
	$(BIN)/python benchmarks/gallery.py

# against other samplers, and in the size of the problem: benchmarks/RESULTS.md; PEERS is a Python that has estim, dynesty, bumps, pymc and nutpie
PEERS ?= $(BIN)/python
bench: $(VENV)/.installed
	$(BIN)/python benchmarks/bench.py --peers $(PEERS)

# disturbances of real laboratories, beside lmfit, SciPy and, where they are installed, iminuit and kafe2: docs/coverage.md; cells in COVERAGE
# are taken up where they stopped
COVERAGE ?= out/coverage
coverage: $(VENV)/.installed
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/interval_coverage.py --out $(COVERAGE) --docs docs

# docs/reference from the code: commands, keys, schema, Python; a test says when it is stale
docs: $(VENV)/.installed
	$(BIN)/python docs/generate

# the pages as a site, out/site/index.html; a link that leads nowhere is an error
site:
	$(PYTHON) -m venv $(VENV)-site
	$(VENV)-site/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement docs/site/requirements.lock
	rm -rf out/site-pages && mkdir -p out/site-pages
	tar -cf - --exclude docs/generate --exclude '*.lock' README.md CHANGELOG.md CONTRIBUTING.md CITATION.cff LICENSE docs reports data benchmarks/RESULTS.md benchmarks/scaling.png \
		| tar -xf - -C out/site-pages
	NO_MKDOCS_2_WARNING=1 $(VENV)-site/bin/mkdocs build --quiet --config-file docs/site/mkdocs.yml
	@echo "open out/site/index.html"

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy

$(VENV)/.installed: pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "estim needs Python 3.11 or newer: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

# after a change of pyproject.toml or constraints.txt: names, versions and hashes of every package that is installed, for every system
lock:
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/python -m pip install --quiet --disable-pip-version-check uv==0.13.9
	$(VENV)-lock/bin/uv pip compile pyproject.toml --extra test --extra dev --constraint constraints.txt --universal --python-version 3.11 \
		--upgrade --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links --quiet --output-file requirements.lock
	$(VENV)-lock/bin/uv pip compile docs/site/requirements.in --universal --python-version 3.11 \
		--upgrade --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links --quiet --output-file docs/site/requirements.lock

clean:
	rm -rf $(VENV) $(VENV)-lock $(VENV)-site out
