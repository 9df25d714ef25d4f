# On a fresh machine, `make demo` and `make test` are enough.
# They need Python 3.11 or newer, bash and make; `make help` lists the other targets.

SHELL := bash
.SHELLFLAGS := -o pipefail -c
.DEFAULT_GOAL := help

# Container images often set it. Every process would then compile all modules again: a second each.
unexport PYTHONDONTWRITEBYTECODE

# The first of these that is Python 3.11, 3.12 or 3.13 (OMPL has no wheel for 3.14 yet).
# To use another one: make demo PYTHON=/path/to/python
PYTHON ?= $(shell for name in python3 python3.11 python3.12 python3.13 python; do \
	"$$name" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null \
	&& echo "$$name" && break; done)

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

# The lock is resolved for one platform; other platforms use the same versions without hashes.
LOCKED := $(if $(filter Linux-x86_64,$(shell uname -s)-$(shell uname -m)),\
	--require-hashes --only-binary :all: --no-deps --requirement requirements.lock,\
	--constraint constraints.txt --editable '.[dev]')

# One test process per core, but at most eight: each of them loads every robot.
WORKERS ?= logical

.PHONY: help setup demo kernels test matrix fuzz soak lint format check docs docs-html constraints clean

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' Makefile

setup: $(STAMP) ## Create .venv and install the project with its tools (done once)

demo: $(STAMP) ## Run the demo: two arms pick, carry and track
	@$(BIN)/bt-run trees/pick_and_track.yaml
	@echo "Next: source $(VENV)/bin/activate, then bt-run --list"

# A run compiles what it needs; test processes would compile the same kernels side by side.
kernels: $(STAMP)
	@$(BIN)/python -c 'import logging; logging.basicConfig(level="INFO", format="%(message)s"); \
		from bt_dualarm.runtime.kernels import compile_kernels; compile_kernels()'

test: kernels ## Run the whole test suite
	@$(BIN)/python -m pytest --numprocesses $(WORKERS) --maxprocesses 8 --dist worksteal --quiet

matrix: export BT_DUALARM_MATRIX := all
matrix: kernels ## Test whole families of similar cases, such as every operation on every kind of file: an hour of CPU
	@$(BIN)/python -m pytest --numprocesses $(WORKERS) --maxprocesses 8 --dist worksteal --quiet \
		$$(grep --recursive --files-with-matches --include='test_*.py' tests.families tests)

fuzz: export BT_DUALARM_FUZZ_FILES ?= 160000
fuzz: export BT_DUALARM_FUZZ_TIMES ?= 160
fuzz: export BT_DUALARM_FUZZ_SEED ?= $(shell date +%s)
fuzz: kernels ## Test 160 times as many mutated trees, robots and meshes as make test, with other seeds
	@echo "BT_DUALARM_FUZZ_SEED=$$BT_DUALARM_FUZZ_SEED repeats this run"
	@$(BIN)/python -m pytest --numprocesses $(WORKERS) --maxprocesses 8 --dist worksteal --quiet \
		tests/fuzz tests/spec/test_fuzz.py

soak: HOURS ?= 24
soak: $(STAMP) ## Let four arms work for 24 simulated hours (HOURS=...), then start and end 1,000 runs
	@$(BIN)/python -m benchmarks.soak --hours $(HOURS)
	@$(BIN)/python -m benchmarks.soak --starts 1000

lint: $(STAMP) ## Check style, layers and types
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/lint-imports --no-cache --no-logo
	@$(BIN)/mypy

format: $(STAMP) ## Format the code and apply the safe fixes
	@$(BIN)/ruff check --fix
	@$(BIN)/ruff format

check: lint test ## Lint, then test: run it before every commit

docs: $(STAMP) ## Regenerate the parts of docs/ that come from the code
	@$(BIN)/python docs/reference.py
	@$(BIN)/python docs/robots.py
	@$(BIN)/python docs/grippers.py
	@$(BIN)/python docs/limits.py
	@$(BIN)/python docs/members.py

docs-html: $(STAMP) ## Build the documentation as a site, site/index.html; broken links are errors
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt \
		--no-build-isolation --editable '.[docs]'
	@$(BIN)/python -m sphinx -q -W --keep-going -b html -d build/doctrees docs site
	@echo "Open site/index.html"

# The newest versions that the oldest Python can install; the other Pythons need wheels of them, too.
constraints: ## Resolve the version ranges of pyproject.toml again: constraints.txt, requirements.lock
	@scratch=$$(mktemp -d) && trap 'rm -rf "$$scratch"' EXIT \
		&& $(PYTHON) -m venv "$$scratch" \
		&& "$$scratch/bin/python" -m pip install --quiet 'uv<1' \
		&& compile() { "$$scratch/bin/uv" pip compile pyproject.toml --extra dev --quiet --upgrade \
			--only-binary :all: --python-platform x86_64-manylinux_2_28 --python-version "$$@"; } \
		&& compile 3.11 --generate-hashes --no-annotate --custom-compile-command 'make constraints' \
			--output-file "$$scratch/lock" \
		&& { sed '/^[^#]/d' constraints.txt && sed -n 's/^\([^ ]*==[^ ]*\).*/\1/p' "$$scratch/lock"; } \
			> "$$scratch/constraints.txt" \
		&& for version in 3.12 3.13; do \
			compile $$version --constraint "$$scratch/constraints.txt" --output-file /dev/null \
				|| exit 1; done \
		&& cp "$$scratch/constraints.txt" constraints.txt && cp "$$scratch/lock" requirements.lock

clean: ## Remove everything that make has created
	@rm -rf $(VENV) build dist out site .mypy_cache .ruff_cache .pytest_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

# One dot per package, so that a slow connection does not look like a hang. Python compiles the modules
# that it imports, a part of all that are installed.
$(STAMP): pyproject.toml requirements.lock
	@test -n "$(PYTHON)" || { \
		echo "No Python 3.11 or newer found. Specify one: make PYTHON=/path/to/python" >&2; exit 1; }
	@echo "Setting up $(VENV) with $(PYTHON): once, one to two minutes, depending on your connection"
	@$(PYTHON) -m venv $(VENV) || { \
		echo "Could not create $(VENV); on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@PYTHONUNBUFFERED=1 PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install --no-compile \
		$(LOCKED) 2> $(VENV)/install.log \
		| awk '/^Collecting/ {printf "."; fflush()} \
			/^Installing collected/ {printf " collected, installing\n"; fflush()}' \
		|| { cat $(VENV)/install.log >&2; exit 1; }
	@PIP_DISABLE_PIP_VERSION_CHECK=1 $(BIN)/python -m pip install --quiet \
		--no-deps --no-build-isolation --editable .
	@touch $(STAMP)
