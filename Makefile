# From a fresh clone, with only Python 3.11+ and make: `make demo`, `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
UNFINISHED := $(VENV)/.unfinished
CUDA := $(VENV)/.cuda
CLUSTER := $(VENV)/.cluster
DOCS := $(VENV)/.docs
OUT ?= results
export MPLBACKEND := Agg

.PHONY: help setup demo test test-slow test-all test-interop lint format docs bench clean

help:
	@echo "make demo    train, evaluate and report at small scale (about five minutes on two free cores); OUT=folder, default results"
	@echo "make test    run the tests of every part, six to eight minutes on two free cores; leaves out the slow ones"
	@echo "make test-slow   run the others, with Ray and the compiler for GPUs; make test-all runs both"
	@echo "make test-interop   run the tests against other libraries, each in an environment of its own; LIBRARIES=names, default all"
	@echo "make lint    format check, lint and types, as in CI"
	@echo "make docs    build the site of the documentation in build/site/html, without warnings"
	@echo "make bench   the paper's comparison: hours of training; OUT=folder, default results"
	@echo "make setup   only make .venv and install what requirements.lock pins: a few minutes"
	@echo "make clean   remove .venv and what tools leave behind (results stay)"

setup: $(READY)

# An interrupted set-up may leave half-copied packages that pip takes for installed: such a .venv is made afresh.
# Any other without pip, such as one of another tool, is somebody's own.
$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "Thalweg needs Python 3.11 or later; '$(PYTHON)' is `$(PYTHON) --version 2>&1 | head -n 1`. Name another: make PYTHON=python3.11" >&2; exit 1; }
	@if [ -n "`ls -A $(VENV) 2>/dev/null`" ] && [ ! -e $(UNFINISHED) ] && ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
	    echo "There is a $(VENV) without a working pip, which 'make setup' has not left unfinished. Remove it, or run $(BIN)/python -m ensurepip" >&2; exit 1; \
	fi
	@if [ -e $(UNFINISHED) ] || [ -z "`ls -A $(VENV) 2>/dev/null`" ]; then \
	    rm -rf $(VENV) && mkdir $(VENV) && touch $(UNFINISHED) && $(PYTHON) -m venv $(VENV); \
	fi
	@touch $(UNFINISHED)
	@echo "Setting up $(VENV): downloading and installing what requirements.lock pins takes a few minutes, PyTorch most of them."
	$(BIN)/python -m pip install --disable-pip-version-check --quiet -r requirements.lock
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation -e .
	@rm -f $(UNFINISHED)
	@touch $@
	@echo "$(VENV) is ready."

# The compiler for GPUs and Ray, which slow tests need: they compile kernels for a card without having one, and run a
# cluster on this machine.
$(CUDA): $(READY) requirements-cuda.lock
	$(BIN)/python -m pip install --disable-pip-version-check --quiet -r requirements-cuda.lock
	@touch $@

$(CLUSTER): $(READY) requirements-cluster.lock
	$(BIN)/python -m pip install --disable-pip-version-check --quiet -r requirements-cluster.lock
	@touch $@

$(DOCS): $(READY) requirements-docs.lock
	$(BIN)/python -m pip install --disable-pip-version-check --quiet --no-deps -r requirements-docs.lock
	@touch $@

demo: $(READY)
	$(BIN)/thalweg bench quick --jobs 1 --out $(OUT)/quick

# Two processes, each of which takes one file at a time, in their order; PyTorch's threads would get in their way.
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

test: $(READY)
	$(PYTEST) -m "not slow"

test-slow: $(READY) $(CUDA) $(CLUSTER)
	$(PYTEST) -m slow

test-all: $(READY) $(CUDA) $(CLUSTER)
	$(PYTEST)

# Environments .venv-interop-NAME with the libraries of tests/interop/locks.
LIBRARIES ?=
test-interop: $(READY)
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.interop.run $(LIBRARIES)

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/pyright

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(DOCS)
	$(BIN)/python docs/site/stage.py build/site/source
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --jobs auto -c docs/site build/site/source build/site/html
	@echo "build/site/html/index.html"

bench: $(READY)
	$(BIN)/thalweg bench paper --out $(OUT)/paper

clean:
	rm -rf $(VENV) $(VENV)-interop-* .pytest_cache .ruff_cache build dist *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
