# Everything a fresh machine needs is Python >= 3.10 with venv and pip, and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

PACKAGED := build/package
# The oldest versions have wheels for these two alone.
OLDEST := build/oldest
OLDEST_PYTHON ?= $(shell for p in python3.10 python3.11; do $$p -c '' 2>/dev/null && echo $$p && break; done)

.PHONY: help setup demo test oldest package lint compiled reference site bench clean

help:
	@echo "make demo   a virtual survey through the ROS 2 graph: what was found against the truth"
	@echo "make test   lint, types and all tests"
	@echo "make oldest   the chain with the oldest versions that setup.py allows (Python 3.10 or 3.11)"
	@echo "make package   source distribution and wheel in dist/; the demo from the wheel in an environment of its own"
	@echo "make bench  ground, roofs, edges, features, outlines, planes, models and the whole chain beside their peers: errors, speed (needs the real clouds)"
	@echo "make site   the documentation as a site in build/site; a warning or a dead link is an error"
	@echo "make reference   write config/pipeline.param.yaml, doc/nodes.md and doc/command_line.md anew"

setup: $(STAMP)

$(STAMP): setup.py pyproject.toml
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 10), "Python 3.10 or newer is needed"'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	@# setuptools warns of every editable installation
	PYTHONWARNINGS=ignore $(BIN)/python -m pip install --quiet --editable '.[ros,test]'
	@touch $(STAMP)

demo: setup compiled
	@echo "A virtual survey:"
	@$(BIN)/python -m lidar_buildings.cli simulate --output demo/survey --scene village --overwrite
	@echo "Through the ROS 2 graph:"
	@$(BIN)/python -m lidar_buildings.cli run demo/survey --output demo/result --overwrite
	@echo "Against the truth:"
	@$(BIN)/python -m lidar_buildings.cli score ground,buildings,edges,outlines,planes,models \
		demo/result demo/survey --merge-touching
	@echo "Results: demo/result (open report.html first; buildings.gpkg, city_model.{city.jsonl,obj,dxf}, classified/, run.json)"
	@echo "Survey and truth: demo/survey (*.laz, truth.gpkg, truth.city.jsonl)"

# One more worker than cores on a small machine: tests of the graph wait more than they compute.
test: setup
	@$(MAKE) --no-print-directory --jobs 3 --output-sync=target lint compiled oldest
	$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# The chain with Ubuntu 24.04's versions: a village from points to models, scored against its truth.
# Only the loops that it needs are compiled.
ifeq ($(OLDEST_PYTHON),)
oldest:
	@echo "make oldest: skipped, as there is neither Python 3.10 nor 3.11"
else
oldest: $(OLDEST)/.installed
	NUMBA_CACHE_DIR= $(OLDEST)/bin/python -m lidar_buildings.cli simulate --output $(OLDEST)/survey --overwrite
	NUMBA_CACHE_DIR= $(OLDEST)/bin/python -m lidar_buildings.cli run $(OLDEST)/survey --output $(OLDEST)/result --overwrite --no-ros
	NUMBA_CACHE_DIR= $(OLDEST)/bin/python -m lidar_buildings.cli score buildings,outlines,models \
		$(OLDEST)/result $(OLDEST)/survey --merge-touching --json >$(OLDEST)/score.json
endif

$(OLDEST)/.installed: setup.py test/oldest_versions.txt
	$(OLDEST_PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python -m pip install --quiet --constraint test/oldest_versions.txt --editable .
	@touch $@

# The wheel as users have it: built from the source distribution, installed elsewhere, run outside of the tree.
package:
	rm -rf dist $(PACKAGED)
	$(PYTHON) -m venv $(PACKAGED)/builder
	$(PACKAGED)/builder/bin/python -m pip install --quiet build
	$(PACKAGED)/builder/bin/pyproject-build --outdir dist . >$(PACKAGED)/build.log
	$(PYTHON) -m venv $(PACKAGED)/user
	$(PACKAGED)/user/bin/python -m pip install --quiet "$$(echo $(CURDIR)/dist/*.whl)[ros]"
	cd $(PACKAGED) && user/bin/lidar-buildings simulate --output survey
	cd $(PACKAGED) && user/bin/lidar-buildings run survey --output result
	cd $(PACKAGED) && user/bin/lidar-buildings score ground,buildings,edges,outlines,planes,models result survey --merge-touching

# Test workers that start without would compile most loops twice.
compiled: setup
	@$(BIN)/python -m lidar_buildings.cli warm-up

bench: setup
	@$(BIN)/python -m pip install --quiet --editable '.[bench]'
	@echo "Terrain scenes:"
	@$(BIN)/python -m bench.ground.scenes
	@echo "ISPRS filter test:"
	@$(BIN)/python -m bench.ground.isprs --offsets 3
	@echo "Providers' ground:"
	@$(BIN)/python -m bench.ground.providers
	@echo "Gross errors:"
	@$(BIN)/python -m bench.ground.noise
	@echo "Ground from the street:"
	@$(BIN)/python -m bench.ground.street
	@echo "Roof scenes:"
	@$(BIN)/python -m bench.roofs.scenes
	@$(BIN)/python -m bench.roofs.spires
	@echo "Buildings on real clouds:"
	@$(BIN)/python -m bench.roofs.run
	@echo "Edges of roofs:"
	@$(BIN)/python -m bench.edges.run
	@$(BIN)/python -m bench.edges.truth
	@echo "Eigenvalue features:"
	@$(BIN)/python -m bench.edges.features
	@echo "Outlines of buildings:"
	@$(BIN)/python -m bench.outlines.run
	@echo "Planes of roofs:"
	@$(BIN)/python -m bench.planes.run
	@echo "Models of buildings:"
	@$(BIN)/python -m bench.models.solids
	@$(BIN)/python -m bench.models.run
	@echo "Speed of the whole chain:"
	@$(BIN)/python -m bench.chain.run

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

reference: setup
	$(BIN)/python -m bench.pages.node_reference
	$(BIN)/python -m bench.pages.command_line doc/command_line.md

site: setup
	$(BIN)/python -m sphinx -W --keep-going -b html doc build/site

clean:
	rm -rf $(VENV) demo build dist
