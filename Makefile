# make study | report | tradeoff | validation | stability | test | test-quick | test-of | coverage | cluster-test | bench | lint | docs | gallery : each sets up .venv by itself; the second time there is nothing to set up.
# Needed: python3 >= 3.11 with venv. Another one: make test PYTHON=python3.12. Another study: make study STUDY=my.yaml
.PHONY: study report tradeoff validation stability test test-quick test-of coverage cluster-test bench lint docs gallery ready ready_dev ready_docs ready_cluster
# Not the default, /bin/sh: for that macOS's make 3.81 looks up programs in the PATH that it was started with.
SHELL := /bin/bash
export PATH := $(CURDIR)/.venv/bin:$(PATH)
PYTHON ?= python3
STUDY ?= config/harrison2020.yaml
CORES ?= $(shell nproc 2> /dev/null || getconf _NPROCESSORS_ONLN)
REPORT ?= report.html
# The locks are complete. uv installs them in a tenth of pip's time; pip does it where there is no uv or it fails, as behind an index of
# packages that only pip was told of. Modules are compiled when they are first imported, which saves half of the time; where Python
# is told not to write byte code, every process would compile them again, so it is done here.
PIP := .venv/bin/python -m pip install --quiet --disable-pip-version-check
UV := UV_HTTP_TIMEOUT=10 UV_HTTP_RETRIES=0 .venv/bin/uv pip install --quiet --system-certs --python .venv
INSTALL := install() { $(UV) $(if $(PYTHONDONTWRITEBYTECODE),--compile-bytecode) "$$@" 2> /dev/null || $(PIP) $(if $(PYTHONDONTWRITEBYTECODE),,--no-compile) "$$@"; }; install --no-deps

study: ready
	@snakemake --cores $(CORES) --configfile "$(STUDY)"

report: ready
	@snakemake --cores $(CORES) --configfile "$(STUDY)" --report "$(REPORT)"

tradeoff: ready
	@snakemake tradeoff_figures --cores $(CORES) --configfile config/tradeoff.yaml

# Published results, reproduced: the studies in config/validation, and the tables and figures of docs/validation.md.
# Some of them: make validation RESULTS="virial equation_of_state"
validation: ready
	@python -m validation $(RESULTS) --cores $(CORES)

# Numerical stability at the extremes, beside other programs; pymunk is among the packages for development. With runs ten times as
# long: make stability LARGE=--large
stability: ready_dev
	@python -m validation.stability $(LARGE)

test: ready_dev
	python -m pytest -n $(CORES) --dist loadfile --no-loadscope-reorder

# Without the tests marked `slow`, of more than half a second of CPU time: studies, benchmarks, statistics of many runs, random faults.
test-quick: ready_dev
	python -m pytest -n $(CORES) --dist loadfile --no-loadscope-reorder -m "not slow"

# The tests that cover a source file: make test-of FILE=src/brownpipe/theory.py
test-of: ready_dev
	@tests=$$(python tests/tests_of.py "$(FILE)") && python -m pytest $$tests

# Which share of the statements outside kernels the tests execute, for each folder of the source; single lines: coverage report -m
coverage: ready_dev
	@coverage erase
	-coverage run -m pytest -n $(CORES) --dist loadfile --no-loadscope-reorder
	@coverage combine --quiet
	@coverage report | awk -f tests/coverage_of_folders.awk | sort

# A study on a Slurm cluster of one node, which is started for it and thrown away. It needs Debian's packages slurm-wlm and munge, and root.
cluster-test: ready_dev ready_cluster
	python -m pytest tests/test_cluster.py --cluster

bench: ready
	for benchmark in benchmarks/bench_*.py; do python $$benchmark || exit 1; done

# snakemake --lint fails for any lint; those left are listed with their reasons in CONTRIBUTING.md, and a test compares.
lint: ready_dev
	ruff check .
	ruff format --check .
	snakefmt --check Snakefile workflow
	mypy
	python -m pytest tests/test_workflow.py -k lint

# The documentation site, with the same bytes for every locale and hash seed. It runs the tutorial. A warning, such as a link to
# nowhere, is an error.
docs: export LC_ALL := C.UTF-8
docs: export PYTHONHASHSEED := 0
docs: ready_docs
	@python docs/_ext/pages.py docs/_build/source
	@python -m sphinx -q -E -W --keep-going -c docs -d docs/_build/doctrees docs/_build/source docs/_build/html
	@echo docs/_build/html/index.html

# The figures of the gallery in docs/gallery/, from all studies in config/: some 20 minutes on two cores.
gallery: ready
	@python docs/_ext/gallery.py $(CORES)

ready: .venv/installed-run
ready_dev ready_docs ready_cluster: ready_%: .venv/installed-run .venv/installed-%

# A stamp is written last, when all that a lock pins is installed: after a failure or Ctrl-C the next `make` installs again.
# A folder that was moved needs a new environment: rm -rf .venv
.venv/created:
	@$(PYTHON) -c "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))" 2> /dev/null || { echo "brownpipe: set-up: $(PYTHON) must be Python >= 3.11 with venv (Debian, Ubuntu: apt install python3-venv); another one: make study PYTHON=python3.12" >&2; exit 1; }
	@echo "brownpipe: set-up: making the environment .venv" >&2
	@$(PYTHON) -m venv .venv
	@$(PIP) uv 2> /dev/null || true
	@touch $@

.venv/installed-run: requirements.lock pyproject.toml | .venv/created
	@echo "brownpipe: set-up: installing the packages of $< into .venv, which takes up to a minute" >&2
	@$(INSTALL) --require-hashes --requirement $<
	@$(INSTALL) --no-build-isolation --editable .
	@$(if $(PYTHONDONTWRITEBYTECODE),.venv/bin/python -m compileall -q src || true)
	@touch $@

.venv/installed-%: requirements-%.lock | .venv/created
	@echo "brownpipe: set-up: installing the packages of $< into .venv" >&2
	@$(INSTALL) --require-hashes --requirement $<
	@touch $@
