# make study | report | tradeoff | validation | stability | test | test-quick | cluster-test | soak | bench | lint | docs | gallery | audit : each sets up .venv by itself; the second time there is nothing to set up.
# Needed: python3 >= 3.11 with venv. Another one: make test PYTHON=python3.12. Another study: make study STUDY=my.yaml
.PHONY: study report tradeoff validation stability test test-quick cluster-test soak bench lint docs gallery audit ready ready_dev ready_docs ready_cluster has_python
SHELL := /bin/bash
export PATH := $(CURDIR)/.venv/bin:$(PATH)
PYTHON ?= python3
STUDY ?= config/harrison2020.yaml
CORES ?= $(shell nproc)
REPORT ?= report.html
# A path as one word of the shell, whatever is in it.
path = $(shell path='$(subst ','\'',$(1))'; [[ $$path != "~/"* ]] || path="$$HOME/$${path:2}"; printf %q "$$path")
study_file := $(call path,$(STUDY))
export UNLOCK_COMMAND := .venv/bin/snakemake --unlock --configfile $(study_file)

study: ready
	@snakemake --cores $(CORES) --configfile $(study_file)

report: ready
	@snakemake --cores $(CORES) --configfile $(study_file) --report $(call path,$(REPORT))

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

# A study on a Slurm cluster of one node, which is started for it and thrown away; it installs Debian's packages slurm-wlm and munge if need be.
cluster-test: ready_dev ready_cluster
	@python tests/slurm.py
	python -m pytest tests/test_cluster.py --cluster

# Faults at random moments, in random bytes and inputs: 10 times as many as in the tests, from a new seed. `tests` is named because
# pytest otherwise looks for the options beside docs/reliability.md, and does not know them.
soak: ready_dev
	python -m pytest tests -n $(CORES) --dist loadfile -m promise --faults 10 --reliability docs/reliability.md

bench: ready
	for benchmark in benchmarks/bench_*.py; do python $$benchmark || exit 1; done

# snakemake --lint fails for any lint; those left are listed with their reasons in CONTRIBUTING.md, and a test compares.
lint: ready_dev
	ruff check .
	ruff format --check .
	snakefmt --check Snakefile workflow
	mypy
	python -m pytest tests/test_workflow.py -k "lint or connects"

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

# The pinned versions against the advisories in workflow/advisories.txt and, with pip-audit, against its database.
audit: ready
	@python workflow/audit.py

ready: has_python
	@$(PYTHON) workflow/set_up.py

ready_dev: has_python
	@$(PYTHON) workflow/set_up.py dev

ready_docs: has_python
	@$(PYTHON) workflow/set_up.py docs

ready_cluster: has_python
	@$(PYTHON) workflow/set_up.py cluster

has_python:
	@command -v $(PYTHON) > /dev/null || { echo "brownpipe: set-up: there is no $(PYTHON); needed is python3 >= 3.11" >&2; exit 1; }
