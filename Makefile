# make demo: four open humans, rendered, verified, pictured in out/demo.
# make test: the whole test suite. Both create .venv and install what they need.
PYTHON ?= python3.11
BIN := .venv/bin
READY := .venv/ready

.PHONY: demo test lint smoke clean

demo: $(READY)
	$(BIN)/python pipeline.py build --config configs/open.yaml --subjects.count 4 --output out/demo
	$(BIN)/python pipeline.py verify out/demo
	$(BIN)/python -m report.sheet out/demo --output out/demo/sheet.png

test: $(READY)
	$(BIN)/python -m pytest

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

smoke: $(READY)
	$(BIN)/python pipeline.py build --config configs/smoke.yaml --output out/smoke
	$(BIN)/python pipeline.py verify out/smoke

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[render,humans,dev]'
	touch $@

clean:
	rm -rf .venv out
