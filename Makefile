# make demo · make test · make bench · make extension: each sets up what it needs in .venv first, and only once.

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

.PHONY: help demo test bench extension clean

help:
	@echo "make demo       scan a virtual person and reconstruct it, into $(DEMO)/"
	@echo "make test       run the tests"
	@echo "make bench      print the benchmark tables"
	@echo "make extension  build the Blender extension for each platform, into dist/"
	@echo "make clean      remove $(VENV) and what was built"

demo: $(VENV)/ready-bpy
	$(BIN)/mirror-scan demo $(DEMO)

test: $(VENV)/ready-bpy,test
	$(PY) -m pytest -q

bench: $(VENV)/ready-bpy,test,bench
	$(PY) -m benchmarks

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
