# make study | tradeoff | test | bench | lint : each sets up .venv by itself; the second time there is nothing to set up.
# Needed: python3 >= 3.11 with venv. Another one: make test PYTHON=python3.12. Another study: make study STUDY=my.yaml
.PHONY: study tradeoff test bench lint
SHELL := /bin/bash
export PATH := $(CURDIR)/.venv/bin:$(PATH)
PYTHON ?= python3
STUDY ?= config/harrison2020.yaml
CORES ?= $(shell nproc)
INSTALLED := .venv/installed

study: $(INSTALLED)
	brownpipe check $(STUDY)
	snakemake --cores $(CORES) --configfile $(STUDY)

tradeoff: $(INSTALLED)
	snakemake tradeoff_figures --cores $(CORES) --configfile config/tradeoff.yaml

test: $(INSTALLED)
	python -m pytest -n $(CORES) --dist loadfile

bench: $(INSTALLED)
	for benchmark in benchmarks/bench_*.py; do python $$benchmark || exit 1; done

# snakemake --lint fails for any lint; those left are listed with their reasons in CONTRIBUTING.md, and a test compares.
lint: $(INSTALLED)
	ruff check .
	ruff format --check .
	snakefmt --check Snakefile workflow
	python -m pytest tests/test_workflow.py -k "lint or connects"

$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "brownpipe needs python3 >= 3.11")'
	$(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --use-pep517 --requirement requirements.lock
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@
