# make study | test | bench | lint : each sets up .venv by itself; the second time there is nothing to set up.
.PHONY: study test bench lint
export PATH := $(CURDIR)/.venv/bin:$(PATH)
PYTHON ?= python3
INSTALLED := .venv/installed

study: $(INSTALLED)
	snakemake --cores 2

test: $(INSTALLED)
	python -m pytest

bench: $(INSTALLED)
	python benchmarks/bench_exact.py

lint: $(INSTALLED)
	ruff check .
	ruff format --check .
	snakefmt --check Snakefile workflow
	snakemake --lint

$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@
