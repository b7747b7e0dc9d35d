# Spikelane in two commands: `make run` drives a lap, `make test` checks everything.
# Both set up what is missing first; PYTHON=/path/to/python3 chooses the Python.
SHELL := /bin/bash
CORE := sim_bridge/spikelane_sim controllers/spikelane_controllers ros2_ws/src/spikelane/spikelane
# As many processes as processors; the tests of a file stay together, as they share what they drive.
WORKERS := -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

.PHONY: help run test docs setup clean

help:
	@echo 'make run    drive a lap of scenario 1: simulator and controller as ROS 2 nodes, recorded'
	@echo 'make test   ruff, mypy and all tests'
	@echo 'make docs   build the documentation as a site: site/index.html'
	@echo 'make setup  only set up what is missing for running'
	@echo 'make clean  remove the environment and everything built; runs/ is kept'

run:
	@./spikelane lap --scenario 1 --controller braitenberg --lane outer --seed 1

test:
	@setup/bootstrap test
	@source setup/env.sh; status=0; \
	python tests/compile_kernels.py & kernels=$$!; \
	ruff check . || status=1; \
	ruff format --check . || status=1; \
	mypy $(CORE) benches/spikelane_benches || status=1; \
	mypy --no-explicit-package-bases setup/bootstrap.py setup/install.py setup/ros_package.py || status=1; \
	mypy ros2_ws/src/spikelane/launch || status=1; \
	wait $$kernels || status=1; \
	python -m pytest $(WORKERS) || status=1; \
	exit $$status

docs:
	@setup/bootstrap docs
	@source setup/env.sh; python -m sphinx -W --keep-going -q -c docs/site . site
	@echo 'site/index.html'

setup:
	@setup/bootstrap run

clean:
	rm -rf .venv ros2_ws/build ros2_ws/install ros2_ws/log
