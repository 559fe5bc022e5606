# Each target makes .venv with what it needs from pyproject.toml, at the versions of constraints.txt, and runs.
PYTHON ?= python3.11
VENV   := .venv
BIN    := $(VENV)/bin
# LeRobot bounds NumPy, PyAV and others lower than the rest needs, and brings PyTorch with CUDA: an environment of its own.
LEROBOT := .venv-lerobot
LEROBOT_EXTRAS := .[lerobot,wandb,test]
PLUGINS := $(wildcard plugins/*)
# ROS 2's wheels restart every Python of the environment that they are in: one of their own, whose nodes the tests start.
ROS := .venv-ros
# mjlab has a MuJoCo and a PyTorch of its own choice: in their own environment they export and record, once, and the tests
# judge the files.
PEERS := .venv-peers
# What pip downloads is shown, and how far it is. Where nobody watches (CI), a line for each package.
PIP := --disable-pip-version-check --progress-bar $(if $(CI),off,on)
# Half of a test of motors is waiting for other threads: one worker more than there are cores.
WORKERS := $(shell echo $$(($$(nproc) + 1)))
# A download of gigabytes that is cut short goes on at the second try, from what pip has kept of the first.
twice = $(1) || $(1)
# The tests start hundreds of Pythons. Where bytecode is not kept, as containers often ask for, each compiles the package again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: play test test-integration test-lerobot test-ros test-peers soak notebooks bench lint format types clean
.DEFAULT_GOAL := play

play: $(VENV)/play.done  ## watch the sample policy move the simulated arms
	$(BIN)/python -m humanoid_sim.play $(ARGS)
	@echo 'Its files are above, in runs/; open the page in a browser. Next:'
	@echo '  make play ARGS="--robot lite_biped --command 0.3,0,0"   a policy that walks'
	@echo '  . $(BIN)/activate; python -m humanoid_sim                what else there is'

test: $(VENV)/test.done  ## lint, the direction of imports, types, and the tests that need neither time nor anything outside
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo
	@# mypy takes one core; on another the tests are compiled, once, and not by each worker for itself.
	$(BIN)/python -m pytest --collect-only -qq >/dev/null 2>&1 & $(BIN)/mypy; types=$$?; wait; exit $$types
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile $(ARGS)

test-integration: $(VENV)/integration.done  ## what only a real part shows: browser, DDS, motors' own clock, wheel, notebooks, Ray
	$(BIN)/python -m pytest -m integration tests/integration $(ARGS)

soak: $(VENV)/integration.done  ## in real time, on a machine with nothing else to do: missed deadlines, endurance, memory, long fuzzing
	$(BIN)/python -m pytest -m soak $(ARGS)

test-lerobot: $(LEROBOT)/test.done  ## the tests with LeRobot, its datasets and its programs; installs about 9 GB at the first time
	HF_HUB_OFFLINE=1 $(LEROBOT)/bin/python -m pytest -m lerobot $(ARGS)

test-ros: $(VENV)/test.done $(ROS)/interfaces.done  ## with ROS 2's rclpy, in network namespaces; needs cmake, ninja and g++
	$(BIN)/python -m pytest -m ros tests/ros2_live $(ARGS)

test-peers: $(VENV)/peers.done $(PEERS)/exports.done  ## with what mjlab and rsl_rl really export, and other programs; installs about 3 GB at the first time
	$(BIN)/python -m pytest -m peers $(ARGS)

notebooks: $(VENV)/integration.done  ## run the notebooks, and store what they show in them; ARGS names some, or has --check
	$(BIN)/python notebooks/store.py $(ARGS)

bench: $(VENV)/play.done  ## this machine's figures
	$(BIN)/python -m tools.bench $(ARGS)

lint: $(VENV)/test.done
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo

format: $(VENV)/test.done
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

types: $(VENV)/test.done
	$(BIN)/mypy

clean:
	rm -rf $(VENV) $(LEROBOT) $(ROS) $(PEERS) build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis

$(VENV)/bin/pip:
	@echo "Making the environment $(VENV) with $(PYTHON): a minute or two, mostly downloading."
	$(PYTHON) -m venv $(VENV)

$(VENV)/play.done: pyproject.toml constraints.txt | $(VENV)/bin/pip
	$(BIN)/pip install $(PIP) -c constraints.txt -e .
	touch $@

$(VENV)/test.done: $(VENV)/play.done
	$(BIN)/pip install $(PIP) -c constraints.txt -e '.[test,dds,midi]'
	touch $@

$(VENV)/integration.done: $(VENV)/test.done
	$(BIN)/pip install $(PIP) -c constraints.txt -e '.[test-integration]'
	touch $@

$(VENV)/peers.done: $(VENV)/test.done
	$(BIN)/pip install $(PIP) -c constraints.txt -e '.[test-peers]'
	touch $@

$(LEROBOT)/test.done: pyproject.toml constraints-lerobot.txt $(PLUGINS:=/pyproject.toml)
	$(PYTHON) -m venv $(LEROBOT)
	$(call twice,$(LEROBOT)/bin/pip install $(PIP) -c constraints-lerobot.txt -e '$(LEROBOT_EXTRAS)' $(PLUGINS:%=-e %))
	touch $@

$(ROS)/test.done: constraints-ros.txt
	$(PYTHON) -m venv $(ROS)
	$(call twice,$(ROS)/bin/pip install $(PIP) -r constraints-ros.txt)
	touch $@

# The compiler takes minutes where it is slow: not the time of a test.
$(ROS)/interfaces.done: $(ROS)/test.done $(wildcard examples/ros2/humanoid_control_msgs/*/* tests/ros2_live/interfaces/*/*/*) tests/ros2_live/interface_package.py
	@echo "Compiling the message types of ROS 2: a minute or two."
	$(PYTHON) tests/ros2_live/interface_package.py
	touch $@

$(PEERS)/test.done: constraints-peers.txt
	$(PYTHON) -m venv $(PEERS)
	$(call twice,$(PEERS)/bin/pip install $(PIP) -r constraints-peers.txt)
	touch $@

# Warp compiles its kernels the first time, for minutes, and finds them in its cache after that.
$(PEERS)/exports.done: $(PEERS)/test.done examples/mjlab_trace.py tests/peers/mjlab_exports.py
	rm -rf $(PEERS)/exports
	@echo "Exporting and recording with mjlab: a minute or two; the first time its kernels are compiled, too."
	WARP_CACHE_PATH=$(PEERS)/warp $(PEERS)/bin/python tests/peers/mjlab_exports.py $(PEERS)/exports >$(PEERS)/exports.log 2>&1 \
	    || { tail -n 50 $(PEERS)/exports.log; false; }
	touch $@
