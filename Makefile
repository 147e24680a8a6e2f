# The commands of this project; `make help` lists them.

PYTHON  ?= python3
CONFIG  ?= config/config.yaml
CORES   ?= 2
PROFILE ?= default
BIN     := .venv/bin
READY   := .venv/ready
# a config of the user's own, if one is given
SWEPT   := $(if $(filter file,$(origin CONFIG)),config/sweep.yaml,$(CONFIG))
# Snakemake finds the default profile by itself; on a cluster the profile says how many cores
RUN := $(BIN)/snakemake $(if $(filter default,$(PROFILE)),--cores $(CORES),\
  --workflow-profile workflow/profiles/$(PROFILE))
SNAKEMAKE := $(RUN) --configfile "$(CONFIG)"
# first, for Snakemake answers a config that is no YAML with a traceback
READ := $(BIN)/python workflow/read_config.py

.DEFAULT_GOAL := help
.PHONY: help environment study check plan unlock diff test check-style test-python test-slurm \
  test-faults baseline bench margin power sweep docs lock clean

help: ## list these commands
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1|/' \
	  | awk -F'|' '{printf "  make %-14s %s\n", $$1, $$2}'
	@echo "  Options: CONFIG=config/config.yaml  CORES=2  PROFILE=default  PYTHON=python3"

environment: $(READY) ## make the Python environment in .venv from the lock file

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo \
	  "ERROR: $(PYTHON) is older than Python 3.11: run make with PYTHON=/path/to/a/newer/python3"; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

study: $(READY) ## run the whole study and build its report
	@$(READ) "$(CONFIG)"
	@$(SNAKEMAKE) || { $(BIN)/python workflow/unlock.py --explain "$(CONFIG)"; exit 1; }
	@$(BIN)/python workflow/build_report.py "$(CONFIG)"

check: $(READY) ## check config, patch table and every file, and say what a run would do
	@$(BIN)/python workflow/check.py "$(CONFIG)" --cores $(CORES)

plan: $(READY) ## show what a study would run, without running it
	@$(READ) "$(CONFIG)"
	@$(SNAKEMAKE) --dry-run --quiet rules

unlock: $(READY) ## remove the lock that a killed run left, unless a run is still at work
	@$(BIN)/python workflow/unlock.py "$(CONFIG)"

diff: $(READY) ## compare two result folders: make diff A=results B=other/results
	@$(BIN)/gst diff $(A) $(B)

test: check-style test-python ## everything that CI runs

check-style: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile workflow/rules
	$(BIN)/python workflow/document.py --check

# one thread: on two cores the small matrix products of a test only wait for each other
# -m '': those that need Slurm, too; where it is not installed they are skipped, and say so
test-python: $(READY)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m ''

test-slurm: $(READY) ## the tiny study through a real Slurm; installs one with apt-get if need be (root)
	tests/slurm/start_slurm.sh --install
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m slurm tests/workflow/test_slurm.py

test-faults: $(READY) ## kill runs, fill disks, damage files, and count what is lost (an hour)
	$(BIN)/python tests/faults/run.py

bench: $(READY) ## measure the contact solver against other codes (half an hour)
	$(BIN)/python benchmarks/run.py

margin: $(READY) ## by how much tables differ, beneath their digits, between cores and processors (10 minutes)
	$(BIN)/python benchmarks/margin.py --config "$(CONFIG)"

power: $(READY) ## how often the study finds a relation, real or absent (15 minutes)
	@$(RUN) power --configfile config/power.yaml
	@cp results-power/tables/power.csv results-power/figures/power.png docs/

baseline: $(READY) ## renew the tables that the default study is held against by the tests
	@$(RUN) --configfile config/config.yaml
	rm -rf tests/baseline && mkdir -p tests/baseline
	cp -r results/tables tests/baseline/

sweep: $(READY) ## what moves the results most, one thing set otherwise at a time (10 minutes)
	@$(READ) "$(SWEPT)" --needs sweep
	@$(RUN) sweep --configfile "$(SWEPT)"
	@echo "Done. Table: tables/sweep.csv; figure: figures/sweep.png, in the results folder"

docs: $(READY) ## renew the parts of the documents that follow from the code
	$(BIN)/python workflow/document.py

lock: $(READY) ## renew requirements.lock with the newest versions that fit
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	  --no-header --no-annotate --extra workflow --extra slurm --extra dev --upgrade \
	  --output-file requirements.lock pyproject.toml

clean: ## remove the results of CONFIG's study (asks first)
	@folder=$$($(BIN)/python workflow/build_report.py --print-folder "$(CONFIG)"); \
	  printf 'Remove %s? [y/N] ' "$$folder"; read answer; [ "$$answer" = y ] && rm -r "$$folder"
