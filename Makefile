# Everything needs Python 3.11 to 3.13 and make; the rest is installed into .venv.
# `make PYTHON=python3.13 lab` picks another Python.

.DEFAULT_GOAL := help
SHELL := /bin/sh

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Written last, so it is there only when everything before it worked.
STAMP := $(VENV)/installed
EXTRAS := learning,oracles,lab,test
# What the first install announces: what `python -m tools.sizes` printed after one with PyTorch's
# build without CUDA (Linux, Python 3.11).
PACKAGES := 190
DOWNLOAD := 1.0 GB
DISK := 3.5 GB
# Where the words of the installer go.
LOG := build/setup.log

export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Compiled modules are kept: the tests start the course in hundreds of processes.
unexport PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE
# The compiler's one-line announcements and a learner's progress are for a person, not for an output
# that is compared. Small matrices are slower with threads, and two workers share the cores.
QUIET := COURSE_QUIET=1 DRILLS_PROGRESS=none OPENBLAS_NUM_THREADS=1
# One worker more than two cores: browsers and what waits for a clock leave a core free.
WORKERS := 3
PYTEST := env $(QUIET) $(BIN)/pytest
# The tests of the claims run each check and compare it with its record; a page shows the record, and
# computes a few cases of what takes long. `make prove` computes all of it for the pages as well.
CLAIMS := recorded
NBVAL := env COURSE_CLAIMS=$(CLAIMS) $(QUIET) $(BIN)/pytest --nbval --nbval-current-env \
	--nbval-sanitize-with tests/nbval_sanitize.cfg --nbval-cell-timeout=120 -n $(WORKERS) --dist loadfile \
	--no-loadscope-reorder

.NOTPARALLEL:
.PHONY: help setup environment platforms sphinx site lab check test prove lint types pytest nbval warm charts notebooks dist clean optional extras cpus

# `make test TOPIC=contact` and `make prove TOPIC=contact`: one topic, and the framework's smoke tests.
TOPIC ?=
OF_TOPIC := $(if $(TOPIC),--topic $(TOPIC))
# The pages that run longest come first, so that no worker is left alone with one.
LONGEST := $(wildcard $(patsubst %,notebooks/??_%.ipynb,pipeline sim_to_real contact perception middleware learning))
NOTEBOOKS := $(if $(TOPIC),$(wildcard notebooks/[0-9][0-9]_$(TOPIC).ipynb),\
	$(LONGEST) $(filter-out $(LONGEST),$(sort $(wildcard notebooks/*.ipynb))))

help: ## show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

# tools/setup.sh does the work. CHOSEN is empty unless somebody chose PYTHON.
SETUP = VENV='$(VENV)' STAMP='$(STAMP)' LOG='$(LOG)' EXTRAS='$(EXTRAS)' PYTHON='$(PYTHON)' \
	CHOSEN='$(filter-out file default,$(origin PYTHON))' GOAL='$(firstword $(MAKECMDGOALS))' \
	PACKAGES='$(PACKAGES)' DOWNLOAD='$(DOWNLOAD)' DISK='$(DISK)' $(SHELL) tools/setup.sh

# Compiling takes a minute or two once, so it belongs to the set-up, as does what only the site and its
# tests need. `make lab` opens at once without it, and compiles in the background.
setup: environment sphinx warm ## make .venv with the pinned packages, and compile the hot loops of the chapters

environment: # .venv, where it isn't there or isn't up to date
	@$(SETUP)

# A Python without a wheel leaves that simulator out (pyproject.toml says which), and the chapter's
# table says so.
platforms: environment ## add the other simulators of chapter 3 (161 MB to download, 510 MB on disk)
	@$(SETUP) add platforms 'the other simulators'

extras: platforms ## add every optional library: the simulators, mink, pink, OpenCV, Stable-Baselines3, wrappers, Dask
	@$(SETUP) add ik,vision,sb3,wrappers,cluster 'the other optional libraries'

sphinx: environment ## add what builds the site (110 MB to download, 440 MB on disk)
	@$(SETUP) add site 'what builds the site'

site: sphinx ## build the site, the course without a kernel, into the folder site
	@OMP_NUM_THREADS=1 COURSE_QUIET=1 $(BIN)/python -m course.site

lab: environment ## set up, then open the course in JupyterLab, in copies under work/
	@echo "compiling the chapters in the background"
	@$(BIN)/python -m tools.warm --background
	@JUPYTER_CONFIG_PATH='$(CURDIR)/.jupyter' exec $(BIN)/python -m tools.lab

check: environment sphinx lint types ## lint, types and the quick tests, in about three minutes
	$(PYTEST) -q -m 'not slow' $(OF_TOPIC) -n 2 --dist worksteal
	@echo "the quick tests passed; make test runs all"

test: environment sphinx lint types warm pytest nbval ## set up, then run every test, or those of TOPIC=contact
	@echo "all tests passed"

optional: extras ## add the optional libraries, and run the tests that need them
	COURSE_REQUIRE_OPTIONAL=1 $(PYTEST) -m optional $(OF_TOPIC) -n $(WORKERS) --dist worksteal
	@echo "the tests of the optional libraries passed"

# The examples of the properties are sampled with this seed, so that a proof can be repeated. Another
# seed samples others: `make prove SEED=2`.
SEED ?= 1
SEEDED = $(PYTEST) --hypothesis-seed=$(SEED)
prove: environment sphinx extras warm ## the long proofs: many seeds, the hostile suite, random properties, other CPUs
	COURSE_PROVE=1 $(SEEDED) $(OF_TOPIC) -n $(WORKERS) --dist worksteal
	COURSE_PROVE=1 $(MAKE) cpus CPUS='haswell nehalem' CLAIMS=computed PYTEST='$(SEEDED)'
	@echo "all proofs passed"

# A CPU is emulated: its instructions are those that the numerical libraries are held to.
CPUS ?= farthest
cpus: environment sphinx ## the claims, the notebooks and what learns, computed as on another CPU
	@set -e; for cpu in $(CPUS); do \
		$(BIN)/python -m tools.cpus $$cpu -- $(BIN)/python -m tools.warm; \
		$(BIN)/python -m tools.cpus $$cpu -- $(PYTEST) -q tests/learning \
			tests/derivations/test_derivations.py -n $(WORKERS) --dist worksteal; \
		$(BIN)/python -m tools.cpus $$cpu -- $(NBVAL) $(NOTEBOOKS); \
	done

lint: environment ## ruff: rules and layout; codespell
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/codespell

types: environment ## Pyrefly
	$(BIN)/pyrefly check

pytest: warm ## the tests without the notebooks
	$(PYTEST) $(OF_TOPIC) -n $(WORKERS) --dist worksteal

nbval: warm ## the notebooks, run again and compared with what they show
	$(if $(NOTEBOOKS),$(NBVAL) $(NOTEBOOKS))

warm: environment ## compile every hot loop of the chapters, or load what was compiled before
	@echo "compiling the hot loops of the chapters: a minute or two the first time"
	@$(BIN)/python -m tools.warm

charts: environment platforms ## rebuild every chart of the README, and the data behind it
	@$(SETUP) add ik,vision 'mink, pink and OpenCV'
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m course.charts
	$(BIN)/python -m tools.gallery

notebooks: environment ## run the notebooks from their sources and write them with their outputs
	$(BIN)/python -m tools.notebooks

# The wheel is that of the sdist. Time stamps are the commit's and modes those of git: of one commit
# both are always the same. What an older build listed in *.egg-info would be taken along.
dist: environment ## build the package, wheel and sdist, into dist/
	rm -rf *.egg-info
	umask 022; SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) \
		$(BIN)/python -m build --no-isolation --outdir dist

clean: ## remove .venv, caches and compiled code
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
