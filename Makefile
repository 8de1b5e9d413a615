# `make demo` and `make test` are all a newcomer needs; `make help` lists the rest.
SHELL := /bin/sh
VENV := .venv
BIN := $(VENV)/bin
OUT ?= runs/demo
EPISODES ?= 5
# Set PYTHON to choose the interpreter: make demo PYTHON=/opt/python3.11/bin/python3
PYTHON ?=
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

.PHONY: help demo docs test check lint slow word-study reproduce screenshots clean

help:
	@echo "make demo    the whole story once, into $(OUT)/report.html (OUT=dir, EPISODES=5)"
	@echo "make test    the test suite without the long runs"
	@echo "make check   format, lint, types, the import rule, fast tests"
	@echo "make slow    the long simulation tests"
	@echo "make docs    the documentation's site, into build/docs/index.html; broken links and examples fail"
	@echo "make word-study  the tables and plots of WORD's accuracy, into runs/word-study"
	@echo "make reproduce   the thesis's experiments, into runs/reproduction; over an hour, resumes where it stopped"
	@echo "make screenshots  the documentation's pictures of the live window, from the real one"
	@echo "make clean   removes the virtual environment and caches; runs/ stays"

demo: $(VENV)/.installed
	@$(BIN)/layflat demo --out "$(OUT)" --episodes $(EPISODES) $(if $(wildcard $(OUT)/report.html),--force)

test: $(VENV)/.installed-dev
	$(BIN)/pytest -m "not slow"

slow: $(VENV)/.installed-dev
	$(BIN)/pytest -m slow --timeout 1800

docs: $(VENV)/.installed-docs
	$(BIN)/python -m sphinx -b html -E -W --keep-going -q docs build/docs
	@echo "open build/docs/index.html"

screenshots: $(VENV)/.installed-dev
	$(BIN)/python -m layflat.tests.app.workstation.screenshots docs/images

word-study: $(VENV)/.installed
	$(BIN)/python -m layflat.app.benchmarks.word_study --out runs/word-study

reproduce: $(VENV)/.installed
	$(BIN)/layflat reproduce --out runs/reproduction

lint: $(VENV)/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	@mkdir -p .cache/typing && ln -sfn ../.. .cache/typing/layflat
	$(BIN)/mypy
	$(BIN)/lint-imports --cache-dir .cache/import-linter

check: lint test

clean:
	rm -rf $(VENV) .cache .ruff_cache build layflat.egg-info
	find app sim perception policy data tests -name __pycache__ -type d -prune -exec rm -rf {} +

# A name on the PATH may be a shim that does not run, so each candidate is tried by running it.
$(BIN)/python:
	@for python in $(PYTHON) python3.11 python3.12 python3.13 python3.10 python3 python; do \
	  if $$python -c 'import ensurepip, sys, venv; sys.exit(sys.version_info[:2] not in ((3, 10), (3, 11), (3, 12), (3, 13)))' \
	      >/dev/null 2>&1; then \
	    echo "making $(VENV) with $$($$python --version)"; \
	    exec $$python -m venv $(VENV); \
	  fi; \
	done; \
	echo "Layflat needs Python 3.10 to 3.13 with venv (PyBullet has no wheels for others): install one, or name it as in 'make PYTHON=/path/to/python3.11 demo'." >&2; \
	exit 1

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing the pinned packages into $(VENV) (once, a minute or two)"
	@$(PIP) install --constraint constraints.txt --editable .
	@touch $@

$(VENV)/.installed-docs: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing the pinned packages and the documentation's tools into $(VENV) (once, a minute or two)"
	@$(PIP) install --constraint constraints.txt --editable '.[docs]'
	@touch $@ $(VENV)/.installed

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing the pinned packages and the test tools into $(VENV) (once, a minute or two)"
	@$(PIP) install --constraint constraints.txt --editable '.[dev]'
	@touch $@ $(VENV)/.installed
