# Everything happens in an environment of its own. Another place: make test VENV=/somewhere/venv
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

.DEFAULT_GOAL := help
.PHONY: help demo test check unit firmware-test lint format screenshot site clean

help: ## Say what there is to make
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 24

demo: $(VENV)/.installed ## Install what is missing, then simulate, record, map and look
	$(BIN)/echogrid demo

test: check unit ## Check style and types, run all tests

check: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/mypy

unit: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n 2

firmware-test: $(VENV)/.installed-dev ## Run the firmware on a simulated chip, record and map its drive
	$(BIN)/python -m pytest -n0 -rs tests/test_firmware.py tests/test_firmware_lines.py

lint: check ## Check style, layout and types
	$(BIN)/ruff format --check .

format: $(VENV)/.installed-dev ## Lay out the code, mend what ruff can mend
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

screenshot: $(VENV)/.installed-dev ## Make all pictures of the README and the docs again
	$(BIN)/python docs/make_screenshot.py
	$(BIN)/python docs/make_rule_pictures.py
	$(BIN)/python docs/make_diff_picture.py
	$(BIN)/python -m docs.make_line_pictures
	-$(BIN)/python -m docs.make_lidar_pictures
	$(BIN)/python docs/make_firmware_pictures.py
	$(BIN)/python docs/make_chapter_pictures.py
	$(BIN)/python -m docs.make_diagnose_picture

site: $(VENV)/.installed-dev ## Build the documentation as a site, build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build -q -f docs/site/mkdocs.yml
	@echo "open build/site/index.html"

clean: ## Remove the environment and all caches
	rm -rf "$(VENV)" build firmware/build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find recorder mapping replay tests benchmarks docs -name __pycache__ -prune -exec rm -rf {} +

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo 'echogrid needs Python 3.11 or newer; name one: make PYTHON=python3.12' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
		{ echo 'Python cannot make environments here: sudo apt install python3-venv' >&2; exit 1; }
	$(PYTHON) -m venv "$(VENV)"

# The order-only prerequisite: the time of the interpreter's file says nothing of what is installed.
$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@ "$(VENV)/.installed"
