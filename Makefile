# Everything a developer runs; each target makes .venv by itself and only when pyproject.toml or constraints.txt changed.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
EGL_PACKAGES := libegl1 libgl1 libgl1-mesa-dri
# Tests run in this many processes; -n 0 runs them in one, for a debugger.
WORKERS ?= 2
PYTEST_ARGS ?=

.PHONY: help setup demo test bench lint format schema stages clean opengl
.DEFAULT_GOAL := help

help:
	@echo "make demo    author zipmaps, pinchmaps and umbrellas from bundled photos, render them and all filters into out/demo"
	@echo "make test    run the tests (WORKERS=2 PYTEST_ARGS=...)"
	@echo "make bench   measure; writes a table and plots into out/bench"
	@echo "make lint    ruff, pyright, codespell"
	@echo "make format  let ruff format and fix what it can"
	@echo "make schema  regenerate what is made from schemas/schema.usda"
	@echo "make stages  regenerate the example stages"
	@echo "make setup   make .venv, without running anything"
	@echo "make clean   remove .venv and everything generated"

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt .ci/make_venv
	@.ci/make_venv "$(PYTHON)" $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench,test,lint]'
	@touch $@

# Headless OpenGL: installed where we may, named where we may not.
opengl: $(STAMP)
	@if ! $(BIN)/python -c 'import ctypes; ctypes.CDLL("libEGL.so.1"); ctypes.CDLL("libGL.so.1")' 2>/dev/null; then \
	    if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	        echo "installing $(EGL_PACKAGES)"; \
	        apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(EGL_PACKAGES) >/dev/null; \
	    else \
	        echo "no EGL: for rendering, run: apt install $(EGL_PACKAGES)" >&2; \
	    fi; \
	fi

demo: $(STAMP) opengl
	@$(BIN)/python -m fexel_tools.demo

test: $(STAMP) opengl
	@$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile $(PYTEST_ARGS)

bench: $(STAMP) opengl
	@$(BIN)/python -m bench

lint: $(STAMP)
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/codespell
	@$(BIN)/pyright

format: $(STAMP)
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

stages: $(STAMP) opengl
	@for script in stages/*/make.py; do echo "$$script"; $(BIN)/python "$$script" || exit 1; done

schema: $(STAMP)
	@$(BIN)/python -m fexel_tools.schema_generation

clean:
	rm -rf $(VENV) out build dist .pytest_cache .ruff_cache .hypothesis
