# What a user types. Every target sets up .venv first; that is quick where nothing is to do.
.PHONY: help setup setup-dev demo test test-slow lint benchmark benchmark-quick metrology metrology-quick bench fuzz mutation docs data lock wheel clean
.NOTPARALLEL:
MAKEFLAGS += --no-print-directory
BIN := .venv/bin
SETUP := $(if $(YES),--yes)
# Two workers on two cores: threads of their own would only wait for each other, a quarter of the time.
ALONE := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# Kept bytecode, also where the environment forbids it: without, each of hundreds of processes compiles what it imports.
export PYTHONDONTWRITEBYTECODE :=

help:
	@echo "make demo       the measured loop: scan, plan, mill, scan, correct, mill, inspect, with a tool that errs; out/demo/report.html"
	@echo "make test       run the tests"
	@echo "make test-slow  run those that take longer or say what others say on further parts (long)"
	@echo "make lint       style, types, import floors, repository"
	@echo "make metrology  score and benchmark, then grooves and prepared plates (long; docs/benchmark.md, score.md, grooves.md)"
	@echo "make metrology-quick  the same over few parts, ten minutes; prints its tables"
	@echo "make benchmark  every method over the open benchmark, one table, best first; docs/benchmark.md"
	@echo "make benchmark-quick  the same over 14 recordings a track, five minutes; prints its table"
	@echo "make bench      speed and memory (long); writes docs/benchmarks.md"
	@echo "make fuzz       mutated files for every reader (long); writes docs/reliability.md"
	@echo "make mutation   errors put into the code at random, and whether the tests tell them (long)"
	@echo "make docs       the pages of the stages and their pictures anew, and the site: out/docs/index.html; runs what the pages tell to run"
	@echo "make data       write the recordings in data/synthetic anew from their recipes"
	@echo "make lock       choose the newest versions of all packages: requirements.lock"
	@echo "make wheel      dist/: a wheel that brings its kernels, for this Python and platform"
	@echo "make clean      remove what was made, .venv too"

setup:
	@scripts/setup.sh $(SETUP)

setup-dev:
	@scripts/setup.sh dev $(SETUP)

demo: setup
	@$(BIN)/workbench run pipelines/measured_loop.json --input 'tool_error_mm=[0.25, -0.2, 0.25]' --out out/demo

test: setup-dev
	@scripts/browser.sh
	@$(ALONE) $(BIN)/python -m pytest -q -n 2 --dist loadfile $(TESTS)

test-slow:
	@$(MAKE) test TESTS="-m slow"

lint: setup-dev
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-cache
	@$(BIN)/python scripts/check_repository.py

benchmark: setup-dev
	@$(BIN)/python -m bench.open --docs

benchmark-quick: setup-dev
	@$(BIN)/python -m bench.open --quick

metrology: setup-dev
	@$(BIN)/python -m bench.score --parts 8 --docs
	@$(BIN)/python -m bench.open --docs
	@$(BIN)/python -m bench.joints --docs

metrology-quick: setup-dev
	@$(BIN)/python -m bench.score --parts 3
	@$(BIN)/python -m bench.open --quick

bench: setup-dev
	@$(BIN)/python -m bench.speed --docs

fuzz: setup-dev
	@$(BIN)/python -m bench.fuzz --docs

mutation: setup-dev
	@$(BIN)/python -m bench.mutation

docs: setup-dev
	@$(BIN)/python -m scripts.pictures
	@$(BIN)/python -m scripts.stage_pages
	@$(BIN)/python -m scripts.checks_table
	@$(BIN)/python -m scripts.site

data: setup
	@$(BIN)/python -m scripts.synthetic_data
	@for name in groove milled_nose; do \
		$(BIN)/python -m bench.simulators.swept bench/simulators/swept/recipes/$$name.json --out data/synthetic/$$name.h5 || exit; done

lock:
	@scripts/lock.sh

wheel: setup
	@$(BIN)/python scripts/compile_kernels.py --into build/kernels
	@WORKBENCH_KERNELS=build/kernels $(BIN)/python -m hatchling build -t wheel -d dist

clean:
	rm -rf .venv out build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
