# `make run` shows the whole chain; `make test-all` proves it, `make test` its parts. All set up by
# themselves.
# `make check` while working, `make test` before a commit, `make test-all` is all that there is.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TRAIN := .venv-train
MINUTES ?= 5
PORT ?= 8080

.PHONY: setup run check test test-lab test-long test-all attack coverage mutants lint js format soak chaos safety bench-perception train train-venv clean bench-accuracy allowances bench-routing bench-quantum bench-world bench-agents bench-service bench-dashboard bench-storage bench-coordination bench-real

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml lab/pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or later is needed") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]' -e ./lab
	touch $@

run: setup
	$(BIN)/slipstream run --port $(PORT)

# Each daemon that a test starts would compile the whole tree again.
unexport PYTHONDONTWRITEBYTECODE

# Workers of a test run. Real processes are started and timed: no more than there are cores.
JOBS ?= 2
PYTEST := -m pytest -n $(JOBS) --dist worksteal

# What starts no process and takes no time.
check: lint js
	$(BIN)/python $(PYTEST) tests -m "not process and not slow"

# The product: real processes and the browser too.
test: lint
	$(BIN)/python $(PYTEST) tests -m "not long"

# The laboratory: whenever it changes, or what it uses of the product; `make test` lints it too.
test-lab: setup
	$(BIN)/python $(PYTEST) lab/tests -m "not long"

# What both leave out; the whole product (tests/e2e, tests/deploy) beside no other test.
test-long: setup
	$(BIN)/python $(PYTEST) -m "long and not nightly and not alone"
	$(BIN)/python -m pytest tests/deploy tests/e2e lab/tests/benchmarks -m "alone and not nightly"

test-all: test test-lab test-long
	$(BIN)/python $(PYTEST) -m "nightly and not alone"
	$(BIN)/python -m pytest tests/e2e -m "alone and nightly"

# An installed machine: clean Debian in a container, install.sh, the shipped units. Needs root.
.PHONY: test-deploy
test-deploy: setup
	$(BIN)/python -m pytest tests/deploy/test_deployment.py

# What attackers and faults do to the daemons, in full size; the figures stand at the end.
attack: setup
	ATTACK_FULL_SIZE=1 $(BIN)/python -m pytest -m attack

# Lines that all tests run, processes that they start included, in per cent of each package.
MEASURED := slipstream storage dispatcher_daemon edge_daemon dashboard
coverage: setup
	rm -rf build/coverage
	$(BIN)/coverage run $(PYTEST)
	$(BIN)/coverage combine --quiet
	@for package in $(MEASURED); do printf '%-20s' $$package; \
	  $(BIN)/coverage report --include="$$package/*" --format=total --fail-under=90 || low=1; \
	done; test -z "$$low"

# Changes the code of pyproject's [tool.mutmut] in small ways, one at a time, and shows which
# changes no test notices. Takes some ten minutes; goes on where it was interrupted.
mutants: $(BIN)/mutmut
	$(BIN)/mutmut run --max-children $(JOBS)
	$(BIN)/mutmut results

$(BIN)/mutmut: | setup
	$(BIN)/python -m pip install --quiet 'mutmut>=3.8,<4'

lint: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The pages' scripts: their unit tests, and their types. Without node, or tsc (`npm install` brings
# it), the one or the other is skipped.
export PATH := $(CURDIR)/node_modules/.bin:$(PATH)
js: setup
	$(BIN)/python -m pytest -q tests/dashboard/web/test_modules.py

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# The page of all settings, from the models that check them.
.PHONY: settings-doc
settings-doc: setup
	$(BIN)/python -m slipstream_cli.settings_doc > docs/settings.md

# The description of the HTTP API, from its routes; a test holds it to them.
.PHONY: openapi fuzz
openapi: setup
	$(BIN)/python -m slipstream_cli.openapi_doc > docs/openapi.json

# 10,000 calls of the HTTP API made up from its description; `make test-long` has a short form.
fuzz: setup
	FUZZ_CALLS=10000 $(BIN)/python -m pytest tests/dispatcher_daemon/service/api/test_fuzz.py

# The same processes on recorded video for MINUTES, sampled each second; fails unless it is sure that
# nothing grows: that takes an hour.
soak: setup
	$(BIN)/python -m slipstream_lab.benchmarks.soak --minutes $(MINUTES)

# FAULTS into the running daemons, one after the other; fails where something is lost or late. As
# root, or where a user may have namespaces; apt: iproute2, libfaketime.
FAULTS ?= 200
chaos: setup
	$(BIN)/python -m slipstream_lab.benchmarks.chaos --faults $(FAULTS)

# STOPS of platoons behind traffic that brakes as hard as it can, over the envelope of
# docs/safety.md; fails where one vehicle touches another.
STOPS ?= 40000
safety: setup
	$(BIN)/python -m slipstream_lab.benchmarks.safety --stops $(STOPS)

# Speed of the edge beside Ultralytics, two cameras live for MINUTES, memory for MEMORY_MINUTES; all
# on an idle machine. PEER is a Python that has Ultralytics; without it its rows are left out.
PEER ?= $(TRAIN)/bin/python
MEMORY_MINUTES ?= 30
bench-perception: MINUTES = 10
bench-perception: setup
	$(BIN)/python -m slipstream_lab.benchmarks.perception --minutes $(MINUTES) --memory-minutes $(MEMORY_MINUTES) --peer $(PEER)

# Speeds, accelerations, flags and identities against the truth of clips that training never saw;
# then the flags in weather, at night and with bad pictures.
bench-accuracy: setup
	$(BIN)/python -m slipstream_lab.benchmarks.accuracy --json .slipstream/accuracy.json
	$(BIN)/python -m slipstream_lab.benchmarks.accuracy.weather
	$(BIN)/python -m slipstream_lab.benchmarks.accuracy.drawn

# What vehicles that nobody saw do to the features: estimated anew on clips that judge nothing; the
# table goes into edge_daemon/features/occlusion.py.
allowances: setup
	$(BIN)/python -m slipstream_lab.benchmarks.accuracy.allowances

# Real roads: DATA is a folder with BrnoCompSpeed's truth and positions in brno/, and clips that labels
# of lab/slipstream_lab/benchmarks/real were drawn on; MODEL is scored on them beside the shipped one.
bench-real: setup
	$(BIN)/python -m slipstream_lab.benchmarks.real --data "$(DATA)" $(if $(MODEL),--model "$(MODEL)")

# The routing core: named instances, cities, fleet sizes, rivals; an hour and a half on an idle
# machine. `SHORT=1` takes small cities and minutes, and leaves the plots in docs as they are.
bench-routing: setup
	$(BIN)/python -m slipstream_lab.benchmarks.routing $(if $(SHORT),--short,--plots docs)

# The quantum solvers: depth, simulation, training, variants, the paper's tables, large blocks, a
# device that fails; about an hour on an idle machine, of which `SHORT=1` takes minutes.
bench-quantum: setup
	$(BIN)/python -m slipstream_lab.benchmarks.quantum $(if $(SHORT),--short)

# The worlds: a day's background, an arm of the closed loop, the same seed twice, what is saved on
# three seeds; hours on an idle machine, and gone on with if interrupted. `SHORT=1`: minutes.
bench-world: setup
	$(BIN)/python -m slipstream_lab.benchmarks.world $(if $(SHORT),--short)

# The real process with one agent and with a hundred, their vehicles driven over the bus.
bench-agents: setup
	$(BIN)/python -m slipstream_lab.benchmarks.agents $(if $(SHORT),--short)

# 10,000 segment states a second into the real dispatcher, then more until some are lost or late;
# orders between and during cycles; a cycle on a cluster with 0, 1 and 2 workers. `ONLY=orders`: one.
bench-service: setup
	$(BIN)/python -m slipstream_lab.benchmarks.service $(if $(SHORT),--short) $(if $(ONLY),--only $(ONLY))

# The operator's page: 1,000 roads with two browsers for an hour, then 10,000. `SHORT=1`: 20 s.
bench-dashboard: setup
	$(BIN)/python -m slipstream_lab.benchmarks.dashboard $(if $(SHORT),--short)

# Coordination of platoons by density, window and carriers, planned only: rivals, upper bound;
# hours, gone on with if interrupted. `SHORT=1`: a minute or two.
bench-coordination: setup
	$(BIN)/python -m slipstream_lab.benchmarks.coordination $(if $(SHORT),--short --out .slipstream/bench-coordination-short)

# Thirty days of 1,000 watched segments in SQLite and in a PostgreSQL server of its own: size,
# queries, deletion; an hour. `SHORT=1`: one day.
bench-storage: setup
	$(BIN)/python -m slipstream_lab.benchmarks.storage $(if $(SHORT),--short)

# What is released, under dist/: packages, a list of what they need with licences (SBOM), and for each
# of ROLES a wheelhouse and a Debian package; an image where buildah is installed. KEY is a gpg key.
ROLES ?= edge agent server worker all
ROLE ?= server
RELEASE := PYTHON=$(PYTHON) sh deploy/release.sh
.PHONY: release locks wheelhouse deb image
release:
	@test -z '$(KEY)' || gpg --batch --list-secret-keys '$(KEY)' >/dev/null
	rm -rf dist
	$(RELEASE) packages
	$(RELEASE) sbom
	set -e; for role in $(ROLES); do \
	  $(RELEASE) wheelhouse $$role; $(RELEASE) deb $$role; \
	  if command -v buildah >/dev/null; then $(RELEASE) image $$role; fi; done
	@command -v buildah >/dev/null || echo 'no images: buildah is not installed'
	KEY='$(KEY)' $(RELEASE) sums

# Upgrades that are killed at any moment; `make test-long` has 20 of them.
.PHONY: power-cuts
power-cuts: setup
	POWER_CUTS=200 $(BIN)/python -m pytest tests/deploy/test_install.py -k power_cuts

# The libraries of each role and each extra, exact versions with hashes: the newest that go together.
locks:
	$(RELEASE) locks

# All that a machine of ROLE needs, for one without a network; EXTRAS=postgres,tracing adds to it.
wheelhouse:
	$(RELEASE) packages
	EXTRAS='$(EXTRAS)' $(RELEASE) wheelhouse $(ROLE)

# The same as a Debian package, and as an OCI image; BASE is an image to build it on.
deb: wheelhouse
	$(RELEASE) deb $(ROLE)

image: wheelhouse
	BASE='$(BASE)' $(RELEASE) image $(ROLE)

# From rendered scenes to the shipped detector; needs torch, so in an environment of its own. With REAL,
# a folder of real pictures, and TEACHER, a COCO model (.xml), it learns from these too; with START it
# goes on from weights (.pt).
train: train-venv
	$(TRAIN)/bin/python -m slipstream_lab.simulation.training --out .slipstream/training \
		$(if $(REAL),--real "$(REAL)" --teacher "$(TEACHER)") $(if $(START),--start "$(START)")

train-venv: $(TRAIN)/bin/yolo

$(TRAIN)/bin/yolo:
	$(PYTHON) -m venv $(TRAIN)
	$(TRAIN)/bin/python -m pip install --quiet -e '.[edge,dispatcher,dashboard]' -e './lab[train]'

clean:
	rm -rf $(VENV) $(TRAIN) .slipstream mutants .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache build dist *.egg-info
