# Two commands: `make demo` and `make test`. Each does all its own set-up in .venv; the second time takes no set-up.
PYTHON_BIN := .venv/bin
NAME ?= all
REALTIME := WAYCHAIR_REALTIME=1 $(PYTHON_BIN)/pytest -q \
	tests/ros/test_stack.py tests/ros/test_mapping.py tests/ros/test_page.py tests/ui/test_browser.py

# A fresh clone compiles its kernels, for some minutes. Those of a whole drive and of a memory of pictures, which are most,
# are compiled first, beside mypy and beside each other: the processes of -n auto would compile the same ones twice.
DRIVE := tests/cli/test_black_box.py
PICTURES := tests/runtime/test_appearance_mapping.py

.PHONY: demo seeds night test set-up lint drive pictures acceptance bench format clean
.DEFAULT_GOAL := test

demo:  ## map a floor by joystick, find oneself on the map, drive to three places; ends in out/demo/report.html
	@bash .ci/setup ui
	@$(PYTHON_BIN)/waychair demo

seeds:  ## twenty seeds of the demo; interrupted, it goes on where it was
	@bash .ci/setup dev
	@$(PYTHON_BIN)/python -m benchmarks.acceptance demo

night:  ## adds hours of simulated driving to those there are: make night HOURS=8
	@bash .ci/setup dev
	@NIGHT_HOURS=$(or $(HOURS),4) $(PYTHON_BIN)/python -m benchmarks.acceptance nights

test: set-up  ## everything that CI runs
	@$(MAKE) --no-print-directory -j2 --output-sync=target lint drive pictures
	@$(PYTHON_BIN)/pytest -q -n auto --ignore=$(DRIVE) --ignore=$(PICTURES)
	@$(REALTIME) || { echo "what failed in real time, once more: another program may have kept the processors"; $(REALTIME) --lf; }

set-up:
	@bash .ci/setup dev

lint: set-up
	@$(PYTHON_BIN)/ruff check .
	@$(PYTHON_BIN)/ruff format --check .
	@$(PYTHON_BIN)/mypy
	@$(PYTHON_BIN)/lint-imports

drive: set-up
	@$(PYTHON_BIN)/pytest -q $(DRIVE)

pictures: set-up
	@$(PYTHON_BIN)/pytest -q $(PICTURES)

acceptance:  ## the figures an issue asks for, in full: make acceptance NAME=intel (or: make acceptance intel)
	@bash .ci/setup dev
	@$(PYTHON_BIN)/python -m benchmarks.acceptance $(or $(filter-out acceptance,$(MAKECMDGOALS)),$(NAME))

bench:  ## speed, as medians and ratios against plain baselines
	@bash .ci/setup dev
	@for f in benchmarks/*.py; do [ "$$f" = benchmarks/__init__.py ] || $(PYTHON_BIN)/python -m $$(echo $${f%.py} | tr / .) || exit 1; done

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
