# Two commands: `make demo` and `make test`. Each does all its own set-up in .venv; the second time takes no set-up.
PYTHON_BIN := .venv/bin
NAME ?= all
REALTIME := WAYCHAIR_REALTIME=1 $(PYTHON_BIN)/pytest -q tests/ros tests/ui
# Each worker begins with a run of neighbouring tests, which share fixtures, and takes over from the other at the end.
PARALLEL := -n auto --dist worksteal

.PHONY: demo seeds night test nightly lint acceptance bench format clean
.DEFAULT_GOAL := test

demo:  ## map a floor by joystick, find oneself on the map, drive to three places; ends in out/demo/report.html
	@bash .ci/setup ui
	@bash .ci/warm
	@$(PYTHON_BIN)/waychair demo

seeds:  ## twenty seeds of the demo; interrupted, it goes on where it was
	@bash .ci/setup dev
	@$(PYTHON_BIN)/python -m evaluation demo

night:  ## adds hours of simulated driving to those there are: make night HOURS=8
	@bash .ci/setup dev
	@NIGHT_HOURS=$(or $(HOURS),4) $(PYTHON_BIN)/python -m evaluation nights

test:  ## everything that CI runs
	@bash .ci/setup dev
	@bash .ci/tests

nightly:  ## what repeats on a larger scale the checks of `make test`; it takes an hour and a half
	@bash .ci/setup dev
	@$(PYTHON_BIN)/pytest -q $(PARALLEL) -m "nightly or hypothesis" --hypothesis-profile=search
	@$(REALTIME) -m "realtime and nightly"

lint:
	@bash .ci/setup dev
	@$(PYTHON_BIN)/ruff check .
	@$(PYTHON_BIN)/ruff format --check .
	@$(PYTHON_BIN)/mypy
	@$(PYTHON_BIN)/lint-imports

acceptance:  ## the figures an issue asks for, in full: make acceptance NAME=intel (or: make acceptance intel)
	@bash .ci/setup dev
	@$(PYTHON_BIN)/python -m evaluation $(or $(filter-out acceptance,$(MAKECMDGOALS)),$(NAME))

bench:  ## speed, as medians and ratios against plain baselines
	@bash .ci/setup dev
	@for f in evaluation/speed/*.py; do [ "$$f" = evaluation/speed/__init__.py ] || $(PYTHON_BIN)/python -m $$(echo $${f%.py} | tr / .) || exit 1; done

format:
	@$(PYTHON_BIN)/ruff check --fix .
	@$(PYTHON_BIN)/ruff format .

clean:
	rm -rf .venv out dist build

# the word after `acceptance` is its argument, not a target
ifneq (,$(filter acceptance,$(MAKECMDGOALS)))
$(filter-out acceptance,$(MAKECMDGOALS)):
	@:
endif
