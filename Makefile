# Everything a newcomer needs: `make demo` and `make test`.
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python; do \
  $$p -c 'import sys; sys.exit(sys.version_info < (3, 12))' 2>/dev/null && { echo $$p; break; }; done)
BIN := .venv/bin
READY := .venv/ready

.PHONY: demo test test-all lint format bench bench-check export-figures clean
.DELETE_ON_ERROR:

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "vsajax needs Python 3.12 or newer; none was found on PATH. Install one, or name it: make PYTHON=/path/to/python3.13 $(MAKECMDGOALS)" >&2; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $@

demo: $(READY)
	rm -rf runs/demo
	$(BIN)/vsajax reproduce serial -o runs/demo/reproduce
	$(BIN)/vsajax init serial runs/demo/study.toml
	$(BIN)/vsajax sweep runs/demo/study.toml -o runs/demo/sweep
	$(BIN)/vsajax tune runs/demo/study.toml -o runs/demo/tune
	$(BIN)/vsajax simulate runs/demo/study.toml -o runs/demo/recording.parquet
	$(BIN)/vsajax estimate runs/demo/recording.parquet -c runs/demo/tune/best.toml -o runs/demo/estimate.parquet
	$(BIN)/vsajax estimate tests/golden/hebi/exampleLog.csv --map configs/logs/hebi.toml \
	  -c configs/tuned/sea_sensor.toml -o runs/demo/real_log.parquet
	$(BIN)/vsajax export runs/demo/tune/best.toml --to json -o runs/demo/export
	@echo "Done. The pictures are in runs/demo and its folders; the tuned configuration is runs/demo/tune/best.toml."

# The library with run-time type checks, and the lab on it as users run it.
test: $(READY)
	$(BIN)/pytest -n 2 --dist loadfile -m 'not slow and not benchmark' tests/vsajax
	$(BIN)/pytest -n 2 --dist loadfile -m 'not slow and not benchmark' --unchecked tests/tuning

test-all: $(READY)
	$(BIN)/pytest -n 2 --dist loadfile -m 'not benchmark'

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/basedpyright

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(READY)
	$(BIN)/vsajax bench --against c

bench-check: $(READY)
	$(BIN)/vsajax bench --check --repeats 5

# The figures of docs/exports.md, measured here.
export-figures: $(READY)
	$(BIN)/python -m tuning.exports.deviations docs/exports.md

clean:
	rm -rf .venv runs
