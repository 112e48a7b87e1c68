# make run: the paper's experiment · make play: robots in the browser · make test: all tests · make check: ruff and
# mypy · make hooks: the same before each commit · make bench: speed, as ratios · make docs: the site, in build/site ·
# make lessons: the programs of the pages, run · make wheel: what is released, tried · make constraints: newer versions
# of what is installed · make proto: the league's messages, from their .proto files
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROTO := omni_mj/live/wire/league
LESSONS := dead-time alpha-and-slip identify

# What was tested, each file by its hash, and then this checkout, which has none; nothing else is fetched.
INSTALL := $(BIN)/python -m pip install -q --disable-pip-version-check --no-deps
LOCKED := $(INSTALL) --require-hashes -r
COMPILE := $(BIN)/uv pip compile -q pyproject.toml --universal --python-version 3.11.5 --generate-hashes --no-header \
  --no-annotate --upgrade

.PHONY: run play test check hooks bench docs lessons wheel proto constraints clean

run: $(VENV)/.installed
	$(BIN)/python -m omni_mj.run --scenario rect --controller flc --controller comp-flc --controller adaptive-comp-flc

play: $(VENV)/.installed
	$(BIN)/python -m omni_mj play --controller flc --controller comp-flc --controller adaptive-comp-flc

# A process for each core, whose matrices are small: threads of their own only wait for each other. Files in their order:
# those with the fewest tests, which would be last, are not the shortest.
test: $(VENV)/.installed-test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

check: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

hooks: $(VENV)/.installed-test
	$(BIN)/python -m pip install -q --disable-pip-version-check pre-commit
	$(BIN)/pre-commit install

bench: $(VENV)/.installed-test
	PYTHONPATH=tests/support $(BIN)/python tests/bench.py
	$(BIN)/python tests/bench_gym.py
	PYTHONPATH=tests/support $(BIN)/python tests/bench_serve.py

# Any warning fails it, for example a link without a target.
docs: $(VENV)/.installed-docs
	$(BIN)/sphinx-build -q -W --keep-going -b html -c docs . build/site
	@echo "the site is in build/site/index.html"

# Run the programs of the lessons, which must print what the pages show, and the commands of all
# other pages. `make lessons WRITE=--write` writes the output and the figures of the lessons.
lessons: $(VENV)/.installed-test
	rm -rf build/lessons && mkdir -p build/lessons
	cd build/lessons && ../../$(BIN)/python ../../docs/tutorials/run.py $(WRITE) $(LESSONS:%=../../docs/tutorials/%.md)
	$(if $(WRITE),cp build/lessons/*.png docs/tutorials/)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m pages -n auto

# The source and the wheel made of it, installed somewhere else and run there: the model and the scenarios must travel along.
wheel: $(VENV)/.installed-release
	rm -rf build/wheel dist && mkdir -p build/wheel
	$(BIN)/python -m build -q --no-isolation -o dist .
	$(BIN)/twine check --strict dist/*
	$(BIN)/python -m venv build/wheel/venv
	build/wheel/venv/bin/python -m pip install -q --disable-pip-version-check --no-deps --require-hashes -r constraints.txt
	build/wheel/venv/bin/python -m pip install -q --disable-pip-version-check --no-deps dist/*.whl
	build/wheel/venv/bin/python -m pip check
	cd build/wheel && venv/bin/omni-mj --scenario rect --set reference.waypoints='[[0, 0], [0.2, 0.1]]'

# The Python module of the league's messages, from their .proto file. Its version must not exceed that of the installed protobuf.
proto: $(VENV)/.installed
	$(BIN)/python -m pip install -q --disable-pip-version-check --no-deps --target build/protoc grpcio-tools==1.85.1 grpcio
	PYTHONPATH=build/protoc $(BIN)/python -m grpc_tools.protoc -I. --python_out=. --pyi_out=. $(PROTO).proto
	sed -i "s/AddSerializedFile(b'/AddSerializedFile(\\n    b'/" $(PROTO)_pb2.py
	sed -E -i "/^    b'/s/.{60,88}[^')x0-9a-f\\\\]/&'\\n    b'/g" $(PROTO)_pb2.py
	sed -i '/_serialized_/d' $(PROTO)_pb2.py  # offsets that only protobuf without its C library reads

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "omni-mj needs Python 3.11 or newer; name one: make PYTHON=python3.12" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BIN)/python pyproject.toml constraints.txt
	$(LOCKED) constraints.txt
	$(INSTALL) --no-build-isolation -e .
	$(BIN)/python -m pip check
	@touch $@

$(VENV)/.installed-test $(VENV)/.installed-docs $(VENV)/.installed-release: $(VENV)/.installed-%: $(VENV)/.installed constraints-%.txt
	$(LOCKED) constraints-$*.txt
	@touch $@

# All versions anew, as far as pyproject.toml lets them; hashes are of all files that a version has for whatever system.
constraints: $(BIN)/python
	$(BIN)/python -m pip install -q --disable-pip-version-check uv
	$(COMPILE) --group build --extra play -o constraints.txt
	$(foreach extra,test docs release,$(COMPILE) -c constraints.txt --extra $(extra) -o constraints-$(extra).txt &&) true
