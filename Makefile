# One command each; every one of them sets up what it needs first. `make` alone lists them.
SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
VENV := .venv/bin
OUTPUT := build/report

.PHONY: help setup report test test-slow test-gpu check format gate publish clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):[^#]*## */  make \1\t/' | expand -t 18

setup:  ## virtual environment in .venv, LLVM where it is missing
	@.ci/setup

report: setup  ## render the built-in scenes both ways; one HTML file
	@$(VENV)/vctgi report --output $(OUTPUT)
	@echo "report: $(CURDIR)/$(OUTPUT)/index.html"

test: setup  ## tests that need neither a GPU nor patience
	@mkdir -p build/test
	@$(VENV)/python -m pytest -m "not slow and not gpu" --junitxml=build/test/junit.xml

test-slow: setup  ## the slow tests
	@mkdir -p build/test
	@$(VENV)/python -m pytest -m "slow and not gpu" --junitxml=build/test/junit-slow.xml

test-gpu: setup  ## the tests that need a CUDA device
	@mkdir -p build/test
	@$(VENV)/python -m pytest -m gpu --junitxml=build/test/junit-gpu.xml

check: setup  ## format, lint, types, import contracts
	@$(VENV)/ruff format --check .
	@$(VENV)/ruff check .
	@$(VENV)/mypy
	@$(VENV)/lint-imports

format: setup  ## rewrite the files as ruff wants them
	@$(VENV)/ruff format .
	@$(VENV)/ruff check --fix .

gate: setup  ## check two small scenes and what artefacts studies find against tests/gates
	@mkdir -p build/gate
	@$(VENV)/vctgi gate tests/gates/gates.toml --variant llvm_ad_rgb --mutants --output build/gate --junit build/gate/junit.xml \
		--markdown build/gate/summary.md

publish: setup  ## the committed snapshot reports/published: pages, charts, summary (6 minutes on two cores)
	@rm -rf build/publish
	@$(VENV)/vctgi report --resolution 96 --spp 4096 --output build/publish/report
	@for study in pareto stability elimination gates leaking banding aliasing flicker; do \
		$(VENV)/vctgi study $$study --quick --output build/publish/studies || [ $$? -ne 2 ]; \
	done
	@$(VENV)/python -m reports.publish --report build/publish/report --studies build/publish/studies \
		--output reports/published

clean:  ## remove what the commands made; keep .venv and the references outside build
	@rm -rf build out .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
