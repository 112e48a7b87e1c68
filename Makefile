# make run: the paper's experiment · make test: all tests · make check: ruff and mypy · make hooks: the same before each
# commit · make bench: speed, as ratios
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test check hooks bench wheel clean

run: $(VENV)/.installed
	$(BIN)/python -m omni_mj.run --scenario rect --controller flc --controller comp-flc --controller adaptive-comp-flc

test: $(VENV)/.installed-test
	$(BIN)/python -m pytest -n auto --dist loadfile

check: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

hooks: $(VENV)/.installed-test
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt pre-commit
	$(BIN)/pre-commit install

bench: $(VENV)/.installed-test
	PYTHONPATH=tests/support $(BIN)/python tests/bench_fuzzy.py
	PYTHONPATH=tests/support $(BIN)/python tests/bench_wire.py
	$(BIN)/python tests/bench.py
	$(BIN)/python tests/bench_serve.py

# A wheel, installed somewhere else and run there: the model and the scenarios must travel with it.
wheel: $(VENV)/.installed
	rm -rf build/wheel && mkdir -p build/wheel
	$(BIN)/python -m pip wheel -q --disable-pip-version-check --no-deps -w build/wheel .
	$(BIN)/python -m venv build/wheel/venv
	build/wheel/venv/bin/python -m pip install -q --disable-pip-version-check -c constraints.txt build/wheel/*.whl
	cd build/wheel && venv/bin/omni-mj --scenario rect --set reference.waypoints='[[0, 0], [0.2, 0.1]]'

clean:
	rm -rf $(VENV) build .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "omni-mj needs Python 3.11 or newer; name one: make PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BIN)/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@
