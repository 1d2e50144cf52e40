# Everything needs Python 3.11 or newer and make; the rest is installed into .venv.
# `make PYTHON=python3.12 lab` picks another Python.

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
unexport PYTHONPATH PYTHONHOME
# The compiler's one-line announcements and a learner's progress are for a person, not for an output
# that is compared. Small matrices are slower with threads, and two workers share the cores.
QUIET := COURSE_QUIET=1 DRILLS_PROGRESS=none OPENBLAS_NUM_THREADS=1

.NOTPARALLEL:
.PHONY: help setup platforms sphinx site lab check test prove lint types pytest nbval warm charts notebooks dist clean

# `make test TOPIC=contact` and `make prove TOPIC=contact`: one topic, and the framework's smoke tests.
TOPIC ?=
OF_TOPIC := $(if $(TOPIC),--topic $(TOPIC))
NOTEBOOKS := $(if $(TOPIC),$(wildcard notebooks/[0-9][0-9]_$(TOPIC).ipynb),notebooks/)

help: ## show this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

# What an installation was made for: if a line differs, it is not the one that is wanted.
# A virtual environment holds absolute paths, so a moved tree needs a new one.
define describe_install
	place='$(CURDIR)/$(VENV)'; \
	wanted=$$(cat pyproject.toml constraints.txt | cksum)
endef

setup: ## make .venv with the pinned packages, if it isn't there
	@set -e; \
	$(describe_install); \
	mkdir -p $(dir $(LOG)); \
	failed() { \
		tail -n 12 $(LOG) >&2; \
		echo "$$1 failed: the last lines are above, all of it is in $(LOG)" >&2; exit 1; \
	}; \
	python_of() { "$$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null; }; \
	had_place=; had_python=; had_packages=; \
	if [ -f $(STAMP) ]; then \
		{ read -r had_place; read -r had_python; read -r had_packages; } < $(STAMP) || true; \
	fi; \
	here=$$(python_of $(BIN)/python) || here=none; \
	case '$(origin PYTHON)' in \
		file|default) asked=$$here ;; \
		*) asked=$$(python_of '$(PYTHON)') || asked=missing ;; \
	esac; \
	if [ ! -d $(VENV) ]; then why="there is none yet"; \
	elif [ -z "$$had_packages" ]; then why="the last install did not finish"; \
	elif [ "$$had_place" != "$$place" ]; then why="the one here was made in $$had_place"; \
	elif [ "$$had_python" != "$$here" ]; then why="its Python was $$had_python and is now $$here"; \
	elif [ "$$asked" != "$$here" ]; then why="it has Python $$here and $(PYTHON) is $$asked"; \
	elif [ "$$had_packages" != "$$wanted" ]; then why=; \
	else echo "$(VENV) is up to date (Python $$here)"; exit 0; fi; \
	if [ -n "$$why" ]; then \
		command -v '$(PYTHON)' >/dev/null || { \
			echo "'$(PYTHON)' was not found. The course needs Python 3.11 or newer;" \
				"name one with: make PYTHON=python3.12 $(firstword $(MAKECMDGOALS))" >&2; exit 1; }; \
		'$(PYTHON)' -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
			echo "'$(PYTHON)' is $$('$(PYTHON)' --version 2>&1). The course needs Python 3.11 or newer;" \
				"name one with: make PYTHON=python3.12 $(firstword $(MAKECMDGOALS))" >&2; exit 1; }; \
		'$(PYTHON)' -c 'import venv, ensurepip' 2>/dev/null || { \
			echo "'$(PYTHON)' has no venv module. On Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }; \
		echo "making $(VENV): $$why"; \
		echo "about $(PACKAGES) packages: about $(DOWNLOAD) to download, $(DISK) on disk" \
			"(several GB more where the package index gives PyTorch with CUDA)"; \
		rm -rf $(VENV); \
		'$(PYTHON)' -m venv $(VENV) >$(LOG) 2>&1 || failed "making $(VENV)"; \
	else \
		echo "updating $(VENV): pyproject.toml or constraints.txt has changed"; \
		rm -f $(STAMP); \
	fi; \
	echo "installing the packages pinned in constraints.txt; $(LOG) has the details"; \
	$(BIN)/python -m pip install -c constraints.txt -e '.[$(EXTRAS)]' >$(LOG) 2>&1 || failed installing; \
	$(BIN)/python -m pip uninstall -q -y rfc3987-syntax lark >>$(LOG) 2>&1 || failed uninstalling; \
	echo "trying the new packages"; \
	$(BIN)/python -c 'import course, jsonschema, nbformat' >>$(LOG) 2>&1 || failed "trying them"; \
	$(BIN)/python -m tools.libraries || { echo "$(VENV) is not ready" >&2; exit 1; }; \
	{ echo "$$place"; python_of $(BIN)/python; echo "$$wanted"; } > $(STAMP); \
	echo "$(VENV) is ready"

# Adds a set of optional packages once: $(call add,extra of pyproject.toml,what that is). The stamp
# holds the pins and the Python it was made for, beside the stamp of the set-up: whatever makes
# .venv anew takes it away.
define add
	@set -e; \
	stamp=$(VENV)/installed-$(1); \
	wanted="$$(sed -n 3p $(STAMP)) $$(sed -n 2p $(STAMP))"; \
	[ "$$(cat $$stamp 2>/dev/null)" != "$$wanted" ] || exit 0; \
	rm -f $$stamp; \
	echo "adding $(2) to $(VENV); $(LOG) has the details"; \
	$(BIN)/python -m pip install -c constraints.txt -e '.[$(1)]' >>$(LOG) 2>&1 || { \
		tail -n 12 $(LOG) >&2; \
		echo "installing failed: the last lines are above, all of it is in $(LOG)" >&2; exit 1; }; \
	echo "$$wanted" > $$stamp
endef

# A Python without a wheel leaves that simulator out (pyproject.toml says which), and the chapter's
# table says so.
platforms: setup ## add the other simulators of chapter 3 (161 MB to download, 510 MB on disk)
	$(call add,platforms,the other simulators)

sphinx: setup ## add what builds the site (110 MB to download, 440 MB on disk)
	$(call add,site,what builds the site)

site: sphinx ## build the site, the course without a kernel, into the folder site
	@OMP_NUM_THREADS=1 COURSE_QUIET=1 $(BIN)/python -m course.site

lab: setup ## set up, then open the course in JupyterLab, in copies under work/
	@echo "compiling the chapters in the background"
	@$(BIN)/python -m tools.warm --background
	@JUPYTER_CONFIG_PATH='$(CURDIR)/.jupyter' exec $(BIN)/python -m tools.lab

check: setup lint types ## lint, types and the quick tests, in about three minutes
	$(QUIET) $(BIN)/pytest -q --quick $(OF_TOPIC) -n 2 --dist worksteal
	@echo "the quick tests passed; make test runs all"

test: setup platforms sphinx lint types warm pytest nbval ## set up, then run every test, or those of TOPIC=contact
	@echo "all tests passed"

prove: setup platforms sphinx warm ## the long proofs: many seeds, the whole hostile suite, properties at random
	$(QUIET) COURSE_PROVE=1 $(BIN)/pytest $(OF_TOPIC) -n 2 --dist worksteal
	@echo "all proofs passed"

lint: setup ## ruff: rules and layout
	$(BIN)/ruff check
	$(BIN)/ruff format --check

types: setup ## mypy
	$(BIN)/mypy

pytest: warm ## the tests without the notebooks
	$(QUIET) $(BIN)/pytest $(OF_TOPIC) -n 2 --dist worksteal

nbval: warm ## the notebooks, run again and compared with what they show
	$(if $(NOTEBOOKS),$(QUIET) $(BIN)/pytest --nbval --nbval-current-env \
		--nbval-sanitize-with tests/nbval_sanitize.cfg --nbval-cell-timeout=120 \
		-n 2 --dist loadfile $(NOTEBOOKS))

warm: setup ## compile and keep every hot loop of the chapters
	@$(BIN)/python -m tools.warm

charts: setup platforms ## rebuild every chart of the README, and the data behind it
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m course.charts
	$(BIN)/python -m tools.gallery

notebooks: setup ## run the notebooks from their sources and write them with their outputs
	$(BIN)/python -m tools.notebooks

# The wheel is that of the sdist. Time stamps are the commit's and modes those of git: of one commit
# both are always the same. What an older build listed in *.egg-info would be taken along.
dist: setup ## build the package, wheel and sdist, into dist/
	rm -rf *.egg-info
	umask 022; SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) \
		$(BIN)/python -m build --no-isolation --outdir dist

clean: ## remove .venv, caches and compiled code
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
