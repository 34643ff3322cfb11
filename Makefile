# Everything a newcomer needs: `make demo` and `make test`.
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python; do \
  $$p -c 'import sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null && { echo $$p; break; }; done)
BIN := .venv/bin
READY := .venv/ready

.PHONY: demo test test-all lint format bench clean
.DELETE_ON_ERROR:

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "vsajax needs Python 3.12 or newer; none was found on PATH. Install one, or name it: make PYTHON=/path/to/python3.13 $(MAKECMDGOALS)" >&2; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

demo: $(READY)
	$(BIN)/python -m tuning.demo runs/demo

test: $(READY)
	$(BIN)/pytest -n 2 -m 'not slow and not benchmark'

test-all: $(READY)
	$(BIN)/pytest -n 2 -m 'not benchmark'

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/basedpyright

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(READY)
	$(BIN)/python -m benchmarks.throughput

clean:
	rm -rf .venv runs
