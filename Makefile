# Everything runs through ./in-env, which finds or makes an environment with DOLFINx.

RANKS = 2
# So many tests on one rank go on at a time, the tests of one file after each other.
WORKERS = 2
SEVERAL = -n $(WORKERS) --dist loadfile
# The time limit ends a deadlock.
PARALLEL = timeout --kill-after=30 3600 mpirun -n $(RANKS)

# $(call optional,TOOL,COMMANDS): a Python of the user's own need not have the tool.
optional = ./in-env sh -c 'if command -v $(1) >/dev/null; then $(2); \
	else echo "SKIPPED: $(1) is not installed (pip install .[dev])"; fi'

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help demo test test-all lint sandbox serial serial-all parallel parallel-all bench peers golden golden-write sweep punches derivatives verification studies docs format image image-test clean

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 13
	@echo 'DOLFINX=latest make ... takes the newest DOLFINx of Debian (sid)'

demo: ## solve demos/block.yml and draw it
	./in-env contact-locking run demos/block.yml

test: lint sandbox serial parallel ## ruff and mypy, the tests, and those for several ranks under mpirun
test-all: lint sandbox serial-all parallel-all ## the same with the slow tests

lint: ## ruff and mypy only
	@$(call optional,ruff,ruff check && ruff format --check)
	@$(call optional,mypy,mypy)

sandbox: ## check that ./in-env loses nothing that is written in its sandbox
	@environment/sandbox-test

serial: ## the tests on one rank, two at a time (WORKERS=2)
	./in-env python3 -m pytest $(SEVERAL)
serial-all:
	./in-env python3 -m pytest $(SEVERAL) -m ""

parallel: ## the tests under mpirun -n 2 (RANKS=2)
	./in-env $(PARALLEL) python3 -m pytest -p no:cacheprovider
parallel-all:
	./in-env $(PARALLEL) python3 -m pytest -p no:cacheprovider -m ""

bench: ## measure tangents, times and errors (minutes) and write benchmarks/results.md and the figure of errors
	./in-env python3 benchmarks/bench.py
	./in-env python3 benchmarks/bound_cost.py
	./in-env python3 benchmarks/tool_distance.py
	./in-env python3 benchmarks/accuracy.py
	./in-env python3 benchmarks/accuracy.py --figure docs/figures/error_over_time.svg

peers: ## solve the same problems by GetFEM, Clarabel and others (seven minutes): benchmarks/peers/results.md and published.md
	CONTACT_LOCKING_PACKAGES=benchmarks/peers/debian-packages.txt ./in-env python3 benchmarks/peers/run.py
	./in-env python3 benchmarks/peers/published.py

SEEDS = 20
FIRST = 0
FAMILIES =
JOBS = 2
LINEAR = auto
N =
sweep: ## solve and judge random problems of many families (SEEDS=20 FIRST=0 FAMILIES= JOBS=2 LINEAR=auto N= DERIVATIVES=): results/sweep
	./in-env env PYTHONPATH=tests:tests/support OMP_NUM_THREADS=1 python3 -m sweep.run --seeds $(SEEDS) --first $(FIRST) --jobs $(JOBS) \
		--linear $(LINEAR) $(if $(N),--n $(N)) $(if $(DERIVATIVES),--derivatives --limit 300) --families $(FAMILIES)

ONLY =
GOLDEN = ./in-env env PYTHONPATH=tests:tests/support OMP_NUM_THREADS=1 python3 -m golden.run --jobs $(JOBS) --only $(ONLY)
golden: ## compare forces, displacements and tangents of some 300 problems with tests/golden/numbers.json (JOBS=2 ONLY=): minutes
	$(GOLDEN)
golden-write: ## write these numbers anew, after a change that is meant to change them (ONLY="demos/block sweep/disc")
	$(GOLDEN) --write

PROBLEMS = 300
punches: ## compare random bodies with edges on a block with nodes against segments (PROBLEMS=300 FIRST=0 JOBS=2): ten minutes
	$(MAKE) sweep FAMILIES=punches SEEDS=$(PROBLEMS)

derivatives: ## compare derivatives of random problems with differences of solves (FIRST=0 JOBS=2): half an hour
	$(MAKE) sweep DERIVATIVES=1 SEEDS=5

verification: ## solve the problems with known answers and write docs/verification.md
	./in-env python3 -m pytest -m "" tests/verification \
		tests/fields/test_data.py::test_v14_four_ranks_agree_with_one --table docs/verification.md

# Of contraction.yml and lost_equilibrium.yml some cases do not converge, as they should (exit code 3).
studies: ## measure the convergence that the paper asserts (ten minutes): docs/studies.md
	for name in theorem_4_9 theorem_4_9_3d theorem_4_9_slip separate_penalties contraction lost_equilibrium; do \
		./in-env contact-locking study demos/studies/$$name.yml || [ $$? -eq 3 ] || exit 1; \
	done
	./in-env python3 demos/studies/theorem_4_10.py
	./in-env python3 demos/studies/local_friction.py
	./in-env python3 demos/studies/locking_stress.py
	./in-env python3 demos/studies/error_bound.py
	./in-env python3 demos/studies/a_priori_rate.py
	./in-env python3 demos/studies/figures.py docs/figures

docs: ## build the documentation in docs/_build/html (two minutes: it runs the demos)
	./in-env sphinx-build -W --keep-going -q -b html docs docs/_build/html

format: ## format the code
	./in-env ruff check --fix
	./in-env ruff format

image: ## build the Docker image contact-locking
	docker build -t contact-locking .

image-test: ## build the Docker image (with buildah if there is no Docker or Podman) and solve in it on two ranks
	environment/image-test

clean: ## remove results and caches in this folder
	rm -rf results build dist docs/_build docs/demos/*.ipynb *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
