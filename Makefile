# What a person types here; .ci/run types the same. Every target does its own set-up.

# Any Python 3.11 or newer that has pip
PYTHON ?= python3

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.stamp

# Caches stay inside .venv: a home folder may be missing or read-only.
export MPLCONFIGDIR ?= $(CURDIR)/$(VENV)/cache/matplotlib
export PIP_DISABLE_PIP_VERSION_CHECK ?= 1

.DEFAULT_GOAL := help
.PHONY: help setup demo demo-cluster pictures serve test check lock

help:
	@echo "make demo     plan for three robots in a warehouse; pictures and schedules in out/"
	@echo "make demo-cluster  plan a batch on a Dask cluster of two workers; who planned how much"
	@echo "make pictures draw the pictures in docs/"
	@echo "make serve    run the service (WHEELPLAN_HOST, WHEELPLAN_PORT; WHEELPLAN_DATA_DIR: out/data)"
	@echo "make test     run the tests"
	@echo "make check    formatting, lint, types and the arrows between the packages"
	@echo "make lock     pin the newest allowed dependencies in requirements*.lock"

setup: $(STAMP)

# The venv is made without pip and filled by PYTHON's own: that needs no ensurepip, which Debian packs separately.
$(STAMP): requirements-dev.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "wheelplan needs Python 3.11 or newer")'
	test -x $(BIN)/python || $(PYTHON) -m venv --without-pip $(VENV)
	$(PYTHON) -m pip --python $(BIN)/python install --quiet --require-hashes -r requirements-dev.lock
	$(PYTHON) -m pip --python $(BIN)/python install --quiet --no-deps --no-build-isolation -e .
	@mkdir -p "$$MPLCONFIGDIR"
	@touch $@

demo: setup
	$(BIN)/python examples/demo.py

demo-cluster: setup
	$(BIN)/python examples/cluster.py

# On a machine that has time: "good" stops where planning takes too long.
pictures: setup
	for drive in ackermann mecanum swerve tricycle; do \
	  $(BIN)/wheelplan plan examples/$$drive.json --format png -o docs/$$drive.png || exit 1; \
	done
	$(BIN)/wheelplan plan examples/warehouse/ackermann.json --map examples/warehouse/warehouse.yaml \
	  --format png -o docs/demo-ackermann.png

serve: export WHEELPLAN_DATA_DIR ?= $(CURDIR)/out/data
serve: setup
	$(BIN)/wheelplan serve

test: setup
	$(BIN)/python -m pytest

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# uv resolves for every platform at once, which pip cannot; nothing else here needs it.
lock: COMPILE = uv --no-cache pip compile --universal --python-version 3.11 --generate-hashes --upgrade \
	--no-header --no-annotate --quiet pyproject.toml
lock:
	set -e; scratch=$$(mktemp -d); trap 'rm -rf "$$scratch"' EXIT; \
	$(PYTHON) -m venv --without-pip "$$scratch"; \
	$(PYTHON) -m pip --python "$$scratch/bin/python" install --quiet uv; \
	"$$scratch"/bin/$(COMPILE) -o requirements.lock; \
	"$$scratch"/bin/$(COMPILE) --extra dev -o requirements-dev.lock
