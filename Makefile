# SPDX-License-Identifier: Apache-2.0
# Everything runs in .venv, which `make setup` builds from requirements.lock.
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: help setup build test demo localize lint format typecheck stubs check-stubs wheel bench golden \
  lock clean

PYTHON ?= python3
OUT ?= out
DEMO ?= demo
VENV := .venv
BIN := $(VENV)/bin
BUILD := build/python
# The Python found above and the certificates of this machine, nothing downloaded behind our back.
export UV_PYTHON_DOWNLOADS := never
export UV_SYSTEM_CERTS := 1
export VIRTUAL_ENV := $(CURDIR)/$(VENV)
# The build finds cmake and ninja of the lock before those of the machine.
export PATH := $(CURDIR)/$(BIN):$(PATH)

# Python sources run from where they are: only these ask for a new build.
COMPILED := pyproject.toml CMakeLists.txt $(wildcard cmake/*.cmake) \
  $(shell find cpp bindings -name '*.cpp' -o -name '*.hpp' -o -name CMakeLists.txt)

help: ## Say what can be made
	@sed -n 's/^\([a-z-]*\):.* ## /\1\t/p' Makefile | expand -t 14

setup: $(VENV)/built ## Build .venv with Pilotage in it
build: setup

# uv takes no notice of pip's configuration, so the index that pip would ask is passed on to it.
$(VENV)/packages: requirements.lock cmake/check_machine.sh
	@sh cmake/check_machine.sh "$(PYTHON)"
	@echo "Installing the locked packages into $(VENV)"
	@test -x $(BIN)/python || "$(PYTHON)" -m venv $(VENV)
	@sed -n '/^uv==/,/[^\\]$$/p' requirements.lock > $(VENV)/uv.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps \
	  --requirement $(VENV)/uv.txt
	@index=$$($(BIN)/python -m pip config list | sed -n "s/^[^=]*\.index-url='\(.*\)'$$/\1/p" | head -n 1); \
	  $(BIN)/uv pip sync --require-hashes $${index:+--default-index "$$index"} requirements.lock
	@touch $@

$(VENV)/built: $(VENV)/packages $(COMPILED)
	@echo "Compiling the C++ core (a few minutes the first time)"
	@$(BIN)/uv pip install --no-build-isolation --no-deps --reinstall-package pilotage \
	  -C build-dir=$(BUILD) -C cmake.define.PILOTAGE_BUILD_TESTS=ON --editable .
	@touch $@

test: setup ## Run every test: C++, then Python
	$(BIN)/cmake --build $(BUILD) --target cpp_tests
	$(BIN)/ctest --test-dir $(BUILD) --output-on-failure --no-tests=error
	$(BIN)/python -m pytest -n 2 --dist loadfile

demo: setup ## Drive a simulated rover 10 m round a yard and find its way from its cameras
	rm -rf "$(DEMO)"
	$(BIN)/pilotage simulate yard --seed 7 --path closed-10m --rate-hz 5 --speed 0.5 --pairs front \
	  -o "$(DEMO)/recording"
	$(BIN)/pilotage localize "$(DEMO)/recording" -o "$(DEMO)/out"
	$(BIN)/pilotage evaluate "$(DEMO)/out"

localize: setup ## Localize one recording: make localize RECORDING=path [OUT=out]
	@test -n "$(RECORDING)" || { echo "usage: make localize RECORDING=path [OUT=out]" >&2; exit 2; }
	$(BIN)/pilotage localize "$(RECORDING)" -o "$(OUT)"

lint: setup ## Check style and formatting, as the commit hooks do
	SKIP=mypy $(BIN)/pre-commit run --all-files --show-diff-on-failure

format: setup ## Put all sources into the house format
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .
	git ls-files -z '*.cpp' '*.hpp' | xargs -0 $(BIN)/clang-format -i

typecheck: setup ## Check the types of the Python sources
	$(BIN)/pre-commit run --all-files mypy

stubs: setup ## Renew the committed stub of the C++ extension
	sh cmake/make_stub.sh $(BIN) src/pilotage/_core.pyi

check-stubs: setup ## Compare the committed stub with the extension
	sh cmake/make_stub.sh $(BIN) build/_core.pyi
	@diff -u src/pilotage/_core.pyi build/_core.pyi || \
	  { echo "src/pilotage/_core.pyi is out of date: run make stubs" >&2; exit 1; }

wheel: setup ## Build a wheel into dist/
	$(BIN)/uv build --wheel --no-build-isolation --out-dir dist

bench: setup ## Compare with plain OpenCV: make bench RECORDING="path ..."
	@test -n "$(RECORDING)" || { echo 'usage: make bench RECORDING="path ..."' >&2; exit 2; }
	$(BIN)/python benchmarks/odometry.py $(RECORDING)

lock: $(VENV)/packages ## Resolve requirements.lock anew; UPGRADE=1 takes newer versions
	$(BIN)/uv pip compile pyproject.toml --group dev --universal --python-version 3.11 \
	  --generate-hashes --no-header --no-emit-index-url $(if $(UPGRADE),--upgrade) \
	  --quiet --output-file requirements.lock

clean: ## Remove what was built; .venv stays
	rm -rf build dist
	rm -f $(VENV)/built
