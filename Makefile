# make demo · make lint · make test · make bench · make extension: each sets up what it needs in .venv first, and only once.

PYTHON ?= $(firstword $(foreach p,python3.11 python3.13 python3,$(shell $(p) -c \
	'import sys, ensurepip, venv; sys.version_info >= (3, 11) and print("$(p)")' 2>/dev/null)))
VENV ?= .venv
DEMO ?= mirror_scan_demo

ifeq ($(OS),Windows_NT)
BIN := $(VENV)/Scripts
else
BIN := $(VENV)/bin
endif
PY := $(BIN)/python

export NUMBA_CACHE_DIR := $(abspath $(VENV))/numba_cache
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: help demo lint test test-slow test-all kernels fuzz test-addon test-window bench extension clean

help:
	@echo "make demo       scan a virtual person and reconstruct it, into $(DEMO)/"
	@echo "make lint       check style, names and types: ruff and mypy"
	@echo "make test       make lint, then all tests but the slow ones, which rarely break"
	@echo "make test-slow  run the tests that make test leaves out"
	@echo "make test-all   make test, make test-slow and make test-window"
	@echo "make fuzz       open $(FUZZ_CASES) damaged captures, some minutes (FUZZ_CASES=N for another number)"
	@echo "make test-addon   run the add-on's tests in each of the Blender modules $(BPYS)"
	@echo "make test-window  run a real Blender with a window (set BLENDER, or MIRROR_SCAN_CHROOT)"
	@echo "make bench      print the benchmark tables; BENCH_OPTIONS=--quick for fewer scenes"
	@echo "make extension  build the Blender extension for each platform, into dist/"
	@echo "make clean      remove $(VENV) and what was built"

demo: $(VENV)/ready-bpy
	$(BIN)/mirror-scan demo $(DEMO)

lint: $(VENV)/ready-bpy,test
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

# Two processes, and no more: the tests hold whole captures in memory. A file's tests stay together, for its fixtures.
PYTEST = $(PY) -m pytest -q -n 2 --dist loadfile

test: lint kernels
	$(PYTEST) -m "not slow"

# tests/blender is a target of its own, test-window.
test-slow: kernels
	$(PYTEST) -m slow --ignore tests/blender

test-all:
	$(MAKE) test
	$(MAKE) test-slow
	$(MAKE) test-window

kernels: $(VENV)/ready-bpy,test
	$(PY) tools/compile_kernels.py

FUZZ_CASES ?= 20000

fuzz: $(VENV)/ready-bpy,test
	MIRROR_SCAN_FUZZ_CASES=$(FUZZ_CASES) $(PY) -m pytest -q tests/core/capture/test_damaged_files.py

# Each bpy fits one Python. Those that are not here are left out, by name. PREPARE_ONLY=1 tests nothing.
BPYS ?= 4.5.15 5.0.1 5.2.3

test-addon: $(BPYS:%=test-addon-%)

test-addon-%:
	@minor=3.11; case $* in 5.[1-9]*) minor=3.13;; esac; \
	python=$$(for p in python$$minor $$HOME/.pyenv/versions/$$minor.*/bin/python; do \
		$$p -c 'import ensurepip, venv' 2>/dev/null && echo $$p && break; done); \
	if [ -z "$$python" ]; then echo "bpy $*: not tested, needs Python $$minor with venv"; exit 0; fi; \
	set -e; venv=$(VENV)-bpy$*; [ -e $$venv/ready-xdist ] || { \
		$$python -m venv $$venv; \
		$$venv/bin/python -m pip install -q bpy==$* numba OpenImageIO tqdm pytest pytest-xdist trimesh scipy; \
		touch $$venv/ready-xdist; }; \
	[ -z "$(PREPARE_ONLY)" ] || { $$venv/bin/python tools/compile_kernels.py; exit; }; \
	echo "bpy $*, $$($$venv/bin/python -c 'import numpy, sys; print("Python", sys.version.split()[0], "numpy", numpy.__version__)')"; \
	$$venv/bin/python tools/compile_kernels.py; \
	$$venv/bin/python -m pytest -q -n 2 --dist loadfile tests/addon

test-window: $(VENV)/ready-bpy,test
	$(PY) -m pytest -q -rs tests/blender

bench: $(VENV)/ready-bpy,test,bench
	$(PY) -m benchmarks $(BENCH_OPTIONS)

# One zip a platform, by Blender's own builder: BLENDER's, or the one in the bpy module. Wheels are kept in wheels/.
extension: $(VENV)/ready-bpy
	$(PY) tools/extension.py --output dist $(EXTENSION_OPTIONS)

clean:
	rm -rf $(VENV) build dist *.egg-info

$(PY):
	@if [ -z "$(PYTHON)" ]; then \
		echo "No Python 3.11 or newer with venv was found. Install Python 3.11 or 3.13 (on Debian: python3.11 and" \
			"python3.11-venv), or name it: make PYTHON=/path/to/python" >&2; \
		exit 1; \
	fi
	$(PYTHON) -m venv $(VENV)

# One stamp for each set of extras; all of a set are resolved together, so that none breaks what another needs.
$(VENV)/ready-%: pyproject.toml | $(PY)
	$(PY) -m pip install -q -e ".[$*]"
	@$(PY) -c 'import importlib.util as u, sys; u.find_spec("bpy") or print("No bpy wheel for Python {}.{} on this" \
		" machine: .blend, .glb and .fbx are left out.\nThere are wheels for Python 3.11 (bpy 5.0.1, or 4.5 LTS) and" \
		" 3.13 (bpy 5.2.3); to use one: make clean, then make PYTHON=python3.11".format(*sys.version_info))'
	@touch "$@"
