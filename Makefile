# Every command sets up what it needs: a virtual environment with the pinned versions of constraints.txt.
PYTHON ?= python3
VENV ?= .venv
OUT ?= runs/demo
BIN = $(VENV)/bin
PIP = $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: demo paper test test-studies test-types test-all test-others fuzz trust mutants coverage lint docs bench package lowest matrix newest audit clean

COMPARE = $(BIN)/galton compare --algorithm ppo --losses gaussian classification --overwrite
demo: $(VENV)/installed  ## PPO's two presets beside each other on two tasks: tables and figures in runs/demo.
	@echo "1 of 2. Gymnasium's Pendulum: doing nothing earns about -1,210."
	$(COMPARE) Pendulum-v1 --seeds 4 --steps 100000 --out $(OUT)/pendulum
	@echo "2 of 2. The LQR: doing nothing earns -26.03, the optimum is -9.77."
	$(COMPARE) lqr --seeds 8 --steps 100000 --out $(OUT)/lqr-ppo

WHAT ?= all
BUDGET ?= small
paper: $(VENV)/installed-dev  ## The paper's figures and page, from training on: WHAT of them, with a BUDGET, in runs/paper.
	$(BIN)/python -m studies.paper reproduce $(WHAT) --budget $(BUDGET)

test-all trust: export CASES = new
# Programs that tests compile more than once, in several processes, are compiled once.
test test-studies test-types test-all trust mutants coverage: export JAX_COMPILATION_CACHE_DIR = $(abspath $(VENV))/jax-cache
test test-studies test-types test-all trust mutants coverage: export JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS = 0.1
# A file stays in one process, which then makes its fixtures and compiles its programs once. The longest files go first,
# and the slowest tests are told.
PYTEST = $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --durations 15 --durations-min 1
# What compiles for seconds to run for milliseconds is not worth optimising, but for the tests that are marked so.
FLAGS = --xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1
UNOPTIMISED = JAX_DISABLE_MOST_OPTIMIZATIONS=1 XLA_FLAGS="$(FLAGS)"
mutants coverage: export JAX_DISABLE_MOST_OPTIMIZATIONS = 1
mutants coverage: export XLA_FLAGS = $(FLAGS)

test: lint  ## Lint, types and the tests of the library that take seconds.
	$(UNOPTIMISED) $(PYTEST) -m "not slow and not optimised" tests --ignore tests/experiments

test-types: $(VENV)/installed-dev  ## The same with shapes and types checked at every call of every function.
	CHECKED=1 $(UNOPTIMISED) $(PYTEST) -m "not slow and not optimised" tests studies/tests

test-studies: $(VENV)/installed-dev  ## The tests of experiments and of the paper's study that take seconds.
	$(UNOPTIMISED) $(PYTEST) -m "not slow and not optimised" tests/experiments studies/tests

test-all: test test-studies  ## Both, and then what takes minutes; learning claims compiled as users compile.
	$(UNOPTIMISED) $(PYTEST) -m "slow and not optimised" studies/tests tests
	$(PYTEST) -m optimised studies/tests tests

test-others: $(VENV)-others/installed  ## Other libraries' environments and trainers, each in that library itself.
	$(VENV)-others/bin/python -c 'import brax, gymnax, mujoco_playground, rsl_rl, skrl, torchrl'
	$(VENV)-others/bin/python -m pytest -n auto --durations 5 tests/others

SECONDS ?= 120
TARGETS ?=
fuzz: $(VENV)/installed-dev  ## Readers of files under strange ones, SECONDS for each of TARGETS; what is found lies in runs/fuzz.
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS) --folder runs/fuzz $(TARGETS)

# About two hours on two cores. With TESTS=tests/test_resume.py only what that file measures.
trust: $(VENV)/installed-dev  ## Measure every promise of docs/trust.md again: results/trust and the page.
	rm -rf build/trust
	CHECKED=1 GALTON_TRUST=build/trust $(BIN)/python -m pytest -n auto $(or $(TESTS),tests studies/tests)
	$(if $(TESTS),,$(MAKE) mutants coverage package lowest matrix newest)
	$(if $(TESTS),,$(BIN)/python benchmarks/starting.py)
	$(BIN)/python -m tests.trust build/trust

# With AREAS="losses plan" only those of tests/mutants.
mutants: $(VENV)/installed-dev  ## Break one thing at a time: does a test notice? results/trust/mutants.json
	$(BIN)/python -m tests.mutants.runner $(AREAS)

# With TESTS=tests/cli what that folder runs is added to what was measured before.
coverage: $(VENV)/installed-dev  ## Which lines of src/galton the tests run that take seconds: results/trust/coverage.json
	$(if $(TESTS),,rm -rf build/coverage)
	@mkdir -p build/coverage
	$(BIN)/python -m coverage run -m pytest -n auto -m "not slow" $(TESTS)
	$(BIN)/python -m coverage combine --append
	$(BIN)/python -m tests.covered

lint: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: $(VENV)/installed-docs  ## The site, from docs/ into build/docs; a warning is an error, and no network is needed.
	$(BIN)/python -m sphinx --fresh-env --fail-on-warning --keep-going --quiet -b html docs build/docs
	@echo "Open build/docs/index.html"

bench: $(VENV)/installed-dev $(VENV)-rejax/installed  ## Speed against others and the machine; rewrites results/benchmarks.
	$(BIN)/python benchmarks/starting.py
	$(BIN)/python benchmarks/sweep_speed.py --rejax $(VENV)-rejax/bin/python
	$(BIN)/python benchmarks/against_sb3.py
	$(BIN)/python benchmarks/against_physics.py
	$(BIN)/python benchmarks/ppo_speed.py
	$(VENV)-rejax/bin/python benchmarks/one_run.py

package: $(VENV)-package/installed  ## The wheel, built twice, looked into, and used with each extra by itself, far from here.
	$(VENV)-package/bin/python tools/package.py

lowest: $(VENV)-package/installed  ## The wheel, used with the lowest versions of libraries that pyproject.toml declares.
	$(VENV)-package/bin/python tools/lowest.py

matrix: $(VENV)-package/installed  ## The wheel with all extras, used under each version of Python that is here.
	$(VENV)-package/bin/python tools/matrix.py

newest: $(VENV)-package/installed  ## The same with the newest versions of libraries, as pip takes them today.
	$(VENV)-package/bin/python tools/matrix.py --newest

audit: $(VENV)-package/installed  ## Whether a known vulnerability is in the pinned versions; needs the network.
	$(VENV)-package/bin/python tools/audit.py

clean:
	rm -rf $(VENV) $(VENV)-others $(VENV)-rejax $(VENV)-package

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Galton needs Python 3.11 or newer; name one with: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) -e '.[experiments]'
	@touch $@

$(VENV)/installed-dev: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) -e '.[dev]'
	@touch $@ $(VENV)/installed $(VENV)/installed-docs

$(VENV)/installed-docs: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PIP) -e '.[experiments,docs]'
	@touch $@ $(VENV)/installed

# What builds and checks the wheel, beside no library of Galton's.
$(VENV)-package/installed: constraints.txt | $(VENV)/bin/python
	$(PYTHON) -m venv $(VENV)-package
	$(VENV)-package/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  build hatch-fancy-pypi-readme hatchling pip-audit twine
	@touch $@

# Other libraries bring gigabytes that nothing else needs: an environment of its own.
$(VENV)-others/installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PYTHON) -m venv $(VENV)-others
	$(VENV)-others/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  -e '.[gymnax,mujoco,playground,torch]' beartype hypothesis pytest pytest-xdist rsl-rl-lib skrl torchrl
	@touch $@

# rejax and sbx, the peers in JAX, need packages that Galton doesn't: an environment of their own.
$(VENV)-rejax/installed: pyproject.toml constraints.txt | $(VENV)/bin/python
	$(PYTHON) -m venv $(VENV)-rejax
	$(VENV)-rejax/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt \
	  -e '.[gymnax,mujoco]' rejax==0.1.3 sbx-rl==0.28
	@touch $@
