# The commands of this project; `make help` lists them.

PYTHON  ?= python3
CONFIG  ?= config/config.yaml
CORES   ?= 2
PROFILE ?= default
BIN     := .venv/bin
READY   := .venv/ready
# the environment with what only the site, the notebooks and some tests need
CHECKS  := .venv/checks
# every package by its hash; one without a wheel is built by the locked setuptools
PIP     := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation
LOCK    := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
  --no-header --no-annotate --upgrade
# on a cluster, the profile sets the number of cores
STUDY   := $(BIN)/gst study $(if $(filter default,$(PROFILE)),--cores $(CORES),--profile $(PROFILE))
# one thread: with two, the small matrix products of a test only wait for each other
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --durations=15
# tests in one file share their fixtures, so they run in one process
PARALLEL := -n $(CORES) --dist loadfile

.DEFAULT_GOAL := help
.PHONY: help environment study check plan diff test test-all style types test-browser test-slurm \
  test-faults hooks baseline expected bench evidence margin power sweep docs site notebooks dist lock

help: ## list these commands
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1|/' \
	  | awk -F'|' '{printf "  make %-14s %s\n", $$1, $$2}'
	@echo "  Options: CONFIG=config/config.yaml  CORES=2  PROFILE=default  PYTHON=python3"

environment: $(READY) ## make the Python environment in .venv from the lock files

$(READY): requirements-build.lock requirements.lock pyproject.toml
	@case "$$PWD" in *[[:space:]\'\"\\\$$\`\&\;\|\<\>\(\)\*\?{}]*) echo \
	  "ERROR: Snakemake cannot run in a folder with a blank, a quote or a bracket in its path: move the project"; exit 1;; esac
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo \
	  "ERROR: $(PYTHON) is older than Python 3.11: run make with PYTHON=/path/to/a/newer/python3"; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(PIP) --require-hashes -r requirements-build.lock
	$(PIP) --require-hashes -r requirements.lock
	$(PIP) --no-deps -e .
	@touch $@

$(CHECKS): $(READY) requirements-checks.lock
	@# --no-deps: the lock has all of them, and one at a version that another refuses
	$(PIP) --no-deps --require-hashes -r requirements-checks.lock
	@touch $@

study: $(READY) ## run the whole study
	@$(STUDY) "$(CONFIG)"

check: $(READY) ## check config, patch table and every file, and list the steps of a run
	@$(BIN)/gst check "$(CONFIG)"

plan: $(READY) ## show what a study would run, without running it
	@$(STUDY) --plan "$(CONFIG)"

diff: $(READY) ## compare two result folders: make diff A=results B=other/results
	@$(BIN)/gst diff $(A) $(B)

test: style types ## check style and types, and run the quick tests (minutes)
	$(PYTEST) $(PARALLEL) -m "not slow and not slurm and not browser"

test-all: test $(CHECKS) ## run all tests: also whole studies, browser, site, Slurm, faults (an hour)
	$(PYTEST) $(PARALLEL) -m "slow and not slurm"
	$(MAKE) test-browser site notebooks
	$(PYTEST) -m slurm
	$(MAKE) test-faults

style: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@# --verbose: its moving display fails beside other versions of rich
	$(BIN)/lint-imports --no-logo --verbose
	$(BIN)/snakefmt --check Snakefile workflow/Snakefile workflow/rules
	@# not a user's own files, in whatever language
	git ls-files -z ':!.test' | xargs -0 $(BIN)/codespell
	$(BIN)/python docs/document.py --check

types: $(READY)
	$(BIN)/mypy

test-browser: $(CHECKS) ## test the pages in Chromium, if it is installed (minutes)
	$(PYTEST) -m browser tests/workflow

test-slurm: $(READY) ## run the tiny study through a real Slurm; installs one with apt-get if needed (root)
	tests/slurm/start_slurm.sh --install
	$(PYTEST) -m slurm

test-faults: $(READY) ## kill runs, fill disks, damage files, and count the losses (an hour)
	$(BIN)/python tests/faults/run.py

hooks: $(READY) ## check the style of each commit before it is made
	$(BIN)/pre-commit install

bench: $(READY) ## measure the contact solver against other codes (90 minutes)
	$(BIN)/python benchmarks/run.py

evidence: $(READY) ## print the results of the committed rows, and their age
	$(BIN)/python benchmarks/two_scales.py
	for name in verdict use strikes left_out power correlated chance statistics_of_contact false_stops measured_surfaces; do \
	  echo "$$name:"; $(BIN)/python benchmarks/$$name.py --tables || exit 1; done
	$(BIN)/python benchmarks/age.py

margin: $(READY) ## measure how much unrounded tables differ between cores and processors (15 minutes)
	$(BIN)/python benchmarks/margin.py --config "$(CONFIG)"

power: $(READY) ## measure how often the study finds a true or a false relation (an hour)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/power.py --processes $(CORES)

baseline: $(READY) ## renew the tables with which the tests compare the default study
	@$(STUDY) config/config.yaml
	rm -rf tests/baseline && mkdir -p tests/baseline
	cp -r results/tables tests/baseline/

expected: $(READY) ## renew the numbers with which the tests compare their small studies (minutes)
	RENEW=1 $(PYTEST) tests/workflow -k "as_expected"

sweep: $(READY) ## vary one input at a time, and compare the results (a quarter of an hour)
	@$(STUDY) "$(CONFIG)"
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python benchmarks/sweep.py --config "$(CONFIG)" --processes $(CORES)

docs: $(READY) ## renew the parts of the documents that are generated from the code
	$(BIN)/python docs/document.py
	$(BIN)/python benchmarks/age.py

site: $(CHECKS) ## make an offline site of documents and API in build/site (warnings are errors)
	@# -E: an unchanged page may quote a changed one
	$(BIN)/python -m sphinx -W --keep-going -E -q -c docs -d build/doctrees . build/site
	@! grep -rE '<(script|link|img)[^>]+https?://' build/site --include='*.html'
	@echo "Done. Open build/site/index.html"

notebooks: $(READY) ## make notebooks of the gallery's scripts in build/notebooks, run without the workflow's packages (minutes)
	rm -rf build/notebooks && mkdir -p build/notebooks && cp docs/gallery/*.py build/notebooks
	$(BIN)/uv venv --quiet --python $(BIN)/python build/notebooks/.venv
	@# the locks as constraints, which give version and hash of each package
	$(BIN)/uv pip install --quiet --python build/notebooks/.venv --refresh-package gstlib --build-constraints requirements.lock \
	  --constraints requirements.lock --constraints requirements-checks.lock . ipykernel jupytext matplotlib nbconvert
	cd build/notebooks && env -u PYTHONPATH .venv/bin/jupytext --quiet --to ipynb --set-kernel python3 --execute *.py

dist: $(READY) ## build wheel and sdist in dist/, and run the sdist's tests on the wheel elsewhere (minutes)
	rm -rf dist && $(BIN)/uv build --quiet --no-build-isolation --python $(BIN)/python --out-dir dist .
	folder=$$(mktemp -d) && tar -xzf dist/*.tar.gz -C "$$folder" --strip-components=1 \
	  && $(BIN)/uv venv --quiet --python $(BIN)/python "$$folder/.venv" \
	  && $(BIN)/uv pip install --quiet --python "$$folder/.venv" --build-constraints requirements-build.lock \
	    --require-hashes -r requirements.lock \
	  && $(BIN)/uv pip install --quiet --python "$$folder/.venv" --no-deps dist/*.whl \
	  && cd "$$folder" && env -u PYTHONPATH $(PYTEST) $(PARALLEL) -m "not slow" tests/library tests/application tests/scripts \
	  && rm -r "$$folder"

lock: $(READY) ## renew the lock files with the newest versions that fit
	$(LOCK) --group build --output-file requirements-build.lock
	$(LOCK) --extra workflow --extra slurm --extra dev --constraints requirements-build.lock \
	  --output-file requirements.lock pyproject.toml
	$(LOCK) --group checks --constraints requirements.lock --output-file requirements-checks.lock
