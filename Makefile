# Two commands: `make bench` scores the paper's compensators and the leaders, `make test` checks the package.
# `make bench-full` scores every controller; `make test-all` adds the second tier: types, pages, browser,
# other compilers, training, studies. `make docs` builds the site.
PYTHON ?= python3
BIN := .venv/bin
# uv where it is installed. Modules are compiled where they are first imported: most of those installed never are.
UV := $(shell command -v uv)
INSTALL := $(if $(UV),$(UV) pip install --quiet --python $(BIN)/python,$(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check)
PIP := $(INSTALL) --constraint constraints.txt
OUT ?= results/bench
SEED ?= $(shell date +%Y%m%d)
QUICK := tests/test_house.py tests/plant tests/signals tests/measurement tests/support tests/identification tests/baselines

PYTHONS ?= 3.11 3.12 3.13 3.14
MATRIX := uv run --no-project --isolated --with-editable '.[lab,minari,test,tune]'
FIRST_TIER := pytest -n 2 --dist worksteal -m "not slow" tests

# Threads of BLAS and OpenMP beside the processes of tests would wait for each other on two cores. In the
# second tier there are three processes: many of its tests wait for a browser, a server or a command.
check test test-all matrix: export OMP_NUM_THREADS = 1
check test test-all matrix: export OPENBLAS_NUM_THREADS = 1

# What a newcomer wants first: the compensators of the paper, those that lead the ranking, and none.
FIRST := none,inversion-free-literal,inversion-free-reference-rate,classical-static,classical-reference-rate,pi-classical-reference-rate,hybrid,adaptive-inverse

.PHONY: audit bench bench-full check test test-all matrix fuzz docs clean

bench: .venv/.core
	$(BIN)/rdpi bench --out $(OUT) --controllers $(FIRST) --ts 2e-4,1e-3

bench-full: .venv/.core
	$(BIN)/rdpi bench --out $(OUT)

test: .venv/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pytest -n 2 --dist worksteal -m "not slow" --durations=30 tests

test-all: test
	$(BIN)/pytest -n 3 --dist worksteal -m slow --durations=60

# Style, types, floors and the laws of the lower rooms: less than a minute once kernels are compiled.
check: .venv/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest -n 2 -q -m "not slow" $(QUICK)

# The first tier on each Python and on the oldest dependencies, each installed apart by uv; torch is left out.
matrix: $(PYTHONS:%=matrix-%)
	$(MATRIX) --python $(firstword $(PYTHONS)) --resolution lowest-direct $(FIRST_TIER)

matrix-%:
	$(MATRIX) --python $* $(FIRST_TIER)

# A night's attacks on every reader; the seed is that of the day, and is printed.
fuzz: .venv/.dev
	$(BIN)/python -m tests.fuzz --structured --cases 100000 --seed $(SEED)
	$(BIN)/python -m tests.fuzz --cases 100000 --seed $(SEED)

# What is installed, and what of it is known to be vulnerable.
audit: .venv/.dev
	$(BIN)/python tests/audit.py

docs: .venv/.docs
	$(BIN)/python -m sphinx -c docs -b html -W --keep-going -q -d build/doctrees . build/site
	@echo "site: build/site/index.html"

.venv/bin/python:
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version.split()[0]) if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv .venv

.venv/.core: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) --editable .
	@touch $@

.venv/.dev: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) --editable '.[dev]'
	@touch .venv/.core $@

.venv/.docs: .venv/bin/python pyproject.toml constraints.txt
	$(PIP) --editable '.[docs,rl]'
	@touch .venv/.core $@

clean:
	rm -rf .venv results build docs/api/generated docs/gallery
