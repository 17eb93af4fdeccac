# Set-up and the two things a newcomer types: make demo, make test.
PYTHON ?= python3
WORKERS ?= 2
VENV := .venv
BIN := $(VENV)/bin
# MicroPython's interpreter as a package for Node.js, in which tests run the program of boards with Wi-Fi.
MICROPYTHON := @micropython/micropython-webassembly-pyscript@1.27.0

# Nothing that was kept on this machine is seen: the cache of meshes is an empty folder. A file's tests stay
# in one worker, which uses one core, because fixtures that are kept in memory are expensive. Without bytecode
# every process that a test starts would compile its modules.
PYTEST = cache=$$(mktemp -d) && trap 'rm -rf "$$cache"' EXIT && DEFSENSE_CACHE="$$cache" \
	OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= \
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

.PHONY: demo test tests quick bench setup check guide clean

# Only what a build needs: 103 of the 174 packages of `make setup`.
demo: $(VENV)/.core
	$(BIN)/defsense build fixtures/devices/joystick

# Linters, types and the guide run next to the tests: the type checker uses one core only.
test: setup
	PYTHON=$(PYTHON) sh setup-system.sh test
	npm install --silent --no-audit --no-fund --no-save --prefix $(VENV)/node $(MICROPYTHON) || \
		echo "Tests of the MicroPython program in its own interpreter will be skipped: npm failed" >&2
	$(MAKE) --jobs=3 tests check guide

tests: setup
	$(PYTEST) -m "not peer" $(TESTS)

# In 90 s: no builds, browsers, simulated boards or long simulations.
quick: setup
	$(PYTEST) -m "not slow and not peer" $(TESTS)

# Other programs, where they are installed, and speeds: see benchmarks/README.md.
bench: setup
	$(PYTEST) -m peer $(TESTS)
	$(BIN)/python -m benchmarks.speed
	$(BIN)/python -m benchmarks.agreement

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy examples/python
	$(BIN)/lint-imports

# Warnings are errors: links, anchors and pictures of every page are good, or there is no site.
guide: setup
	$(BIN)/python -m sphinx -W --keep-going -q -E -a -b html docs build/guide
	@echo "open build/guide/index.html"

setup: $(VENV)/.ready

SOURCES := pyproject.toml setup-system.sh setup.py $(wildcard kernels/*)

$(VENV)/.ready: requirements.lock $(SOURCES)
	$(call install,requirements.lock)
	touch $(VENV)/.core $@

$(VENV)/.core: requirements-core.lock $(SOURCES)
	$(call install,requirements-core.lock)
	touch $@

# uv is faster, but ignores the settings of pip, such as another index.
define install
PYTHON=$(PYTHON) sh setup-system.sh
$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(not (3, 11) <= v <= (3, 13) and f"Python 3.11, 3.12 or 3.13 is needed, this is {v[0]}.{v[1]}: make PYTHON=python3.13")'
test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
{ command -v uv >/dev/null && uv pip install --python $(BIN)/python --no-deps -r $(1); } || $(BIN)/python -m pip install --no-deps -r $(1)
$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --config-settings editable_mode=compat -e .
endef

clean:
	rm -rf $(VENV) defsense_fab/core/machine/kernels.abi3.so fixtures/devices/*/build fixtures/devices/*/.build-*
