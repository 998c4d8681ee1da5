# make demo    a recorded hand, put on the table it sank into: out/gallery_hand.mcap and .rrd
# make test    the tests but the slow ones; make test-all: all of them, test-versions and distribution
# make test-numba   the tests that compile, with the oldest numba allowed
# make test-versions  some tests and replays with Python 3.11 to 3.13, oldest and newest packages; are the bytes the same?
# make distribution   wheel and sdist, each tried with Python 3.11 to 3.13 in an environment of its own, outside the checkout
# make check   format, lint, types, documents
# make fuzz    hostile bytes through every loader, for FUZZ_SECONDS of processor time (default 600): out/fuzz/
# make bench   frame times per stage
# make figures the experiments' pictures and frame times: assets/docs/figures.md
# make methods the published method beside ours on the recordings: assets/docs/methods.md
# make weights  each weight of the objective varied on the recordings: assets/docs/weights.md
# make format  put the code and the generated pages of assets/docs/ into shape
# make clean   remove what the others made
#
# Another Python than python3:  make demo PYTHON=python3.12

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
MESHES := $(shell find assets -type f 2>/dev/null)

.DELETE_ON_ERROR:
.PHONY: demo distribution test test-all test-numba test-versions check fuzz bench figures methods weights format clean

demo: $(VENV)/.runtime out/gallery_hand.mcap
	@echo
	@echo "Look at it:   $(BIN)/geomphys view out/gallery_hand.rrd"
	@echo "The data:     out/gallery_hand.mcap   (opens in rerun and Foxglove too)"

out/gallery_hand.mcap: recordings/gallery_hand.mcap $(MESHES) $(VENV)/.runtime
	@mkdir -p out
	$(BIN)/geomphys replay recordings/gallery_hand.mcap --scene assets/scenes/gallery.toml \
		-o out/gallery_hand.mcap --rrd out/gallery_hand.rrd --force

# as many processes as there are cores, but no more than four: each takes a gigabyte
PYTEST := -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal

test: $(VENV)/.test
	$(BIN)/python $(PYTEST)

test-all: $(VENV)/.test test-versions distribution
	$(BIN)/python $(PYTEST) -m ""

OLDEST_NUMBA := 0.67
test-numba: $(VENV)/.test
	@rm -rf out/numba
	$(PIP) install --target out/numba 'numba==$(OLDEST_NUMBA).*'
	PYTHONPATH=out/numba $(BIN)/python $(PYTEST) tests/simulated tests/driven tests/engine/test_pipeline.py; \
		code=$$?; rm -rf out/numba; exit $$code

test-versions:
	PYTHON=$(PYTHON) .ci/test_versions $(SETS)

distribution:
	.ci/check_distribution $(VERSIONS)

check: $(VENV)/.test
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python $(PYTEST) tests/house

FUZZ_SECONDS ?= 600
fuzz: $(VENV)/.fuzz
	$(BIN)/python -m tests.fuzz.run $(FUZZ_SECONDS)

bench: $(VENV)/.bench
	$(BIN)/geomphys bench

figures: $(VENV)/.plots $(VENV)/.bench
	$(BIN)/python assets/make_figures.py

methods: $(VENV)/.plots
	$(BIN)/python assets/compare_methods.py

weights: $(VENV)/.plots
	$(BIN)/python assets/vary_weights.py

format: $(VENV)/.test
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .
	$(BIN)/python tests/house/listing.py
	$(BIN)/python tests/house/reference.py
	$(BIN)/python tests/house/output_reference.py

clean:
	rm -rf $(VENV) out build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The environment and what is installed in it. A stamp file says which part is there.

$(VENV)/.venv:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "geomphys needs Python 3.11 or newer, and \`$(PYTHON)\` is $$($(PYTHON) --version 2>&1 || echo not there)." >&2; \
		echo "Name another one:  make $(firstword $(MAKECMDGOALS)) PYTHON=python3.12" >&2; exit 1; }
	@echo "Making $(VENV) …"
	@$(PYTHON) -m venv --clear $(VENV) || { \
		echo "\`$(PYTHON) -m venv\` failed; on Debian and Ubuntu: apt-get install python3-venv" >&2; exit 1; }
	@touch $@

$(VENV)/.runtime: pyproject.toml $(VENV)/.venv
	@echo "Installing geomphys and what it needs into $(VENV) (some minutes the first time) …"
	@$(PIP) install --editable .
	@touch $@

$(VENV)/.plots: pyproject.toml $(VENV)/.venv
	@echo "Installing geomphys and what it draws with into $(VENV) (some minutes the first time) …"
	@$(PIP) install --editable '.[plots]'
	@touch $@ $(VENV)/.runtime

$(VENV)/.test: pyproject.toml $(VENV)/.venv
	@echo "Installing geomphys and what its tests need into $(VENV) (some minutes the first time) …"
	@$(PIP) install --editable '.[test]'
	@touch $@ $(VENV)/.runtime

$(VENV)/.fuzz: $(VENV)/.test
	@$(PIP) install --editable '.[test,fuzz]'
	@touch $@

$(VENV)/.bench: pyproject.toml $(VENV)/.venv
	@echo "Installing geomphys and its peers into $(VENV) (some minutes the first time) …"
	@$(PIP) install --editable '.[bench]'
	@touch $@ $(VENV)/.runtime
