# make demo: four open humans, rendered, verified, shown in out/demo/report.html.
# make test: the whole test suite. Both create .venv and install what they need.
# make humans: fifty of them, with the figures and pictures of docs/subjects.md.
# make learned: fifty of them, and both branches of the trainer, with the figures of their docs.
PYTHON ?= python3.11
BIN := .venv/bin
READY := .venv/ready
# smplx is licensed for research alone; the tests need it, the open humans do not.
TESTABLE := .venv/testable

.PHONY: demo picture humans learned test lint smoke clean

demo: $(READY)
	$(BIN)/python pipeline.py build --config configs/open.yaml --subjects.count 4 --output out/demo
	$(BIN)/python pipeline.py verify out/demo
	$(BIN)/python -m report.sheet out/demo --output out/demo/sheet.png
	$(BIN)/python pipeline.py report out/demo

test: $(TESTABLE)
	$(BIN)/python -m pytest

lint: $(TESTABLE)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The pictures in the README and docs that come from the demo's dataset; the page's needs Chromium.
picture: demo
	$(BIN)/python -m report.sheet out/demo --subjects open_0000 open_0003 --output docs/demo.png
	$(BIN)/python -m report.browser out/demo/report.html --height 760 --output docs/report.png
	$(BIN)/python -m report.sensors out/demo --output docs/sensors.png
	$(BIN)/python pipeline.py sweep --config configs/light_sweep.yaml --data out/demo --output out/sweep
	$(BIN)/python -m report.powers out/sweep --output docs/light_sweep.png

HUMANS := out/humans

humans: $(READY)
	$(BIN)/python pipeline.py build --config configs/open.yaml --subjects.count 50 \
		--views.yaw_deg '[0, -30, -15, 15, 30]' --output $(HUMANS)
	$(BIN)/python pipeline.py verify $(HUMANS)
	$(BIN)/python -m report.differences $(HUMANS) --output docs/differences.png
	$(BIN)/python -m report.people $(HUMANS) --output docs/people.png \
		--subjects $(shell seq -f open_%04g 0 23)
	$(BIN)/python -m report.humans $(HUMANS) --output $(HUMANS)/humans.json

# The trainer's figures in docs/training.md: a dataset to learn from, both branches, the test.
learned: $(TESTABLE)
	$(BIN)/python pipeline.py build --config configs/open.yaml --subjects.count 50 \
		--output out/people
	$(BIN)/python pipeline.py train --config configs/train_front_cpu.yaml \
		--data out/people --output out/people_front
	$(BIN)/python pipeline.py train --config configs/train_back_cpu.yaml \
		--data out/people --output out/people_back
	$(BIN)/python -m benchmarks.branches out/people \
		--front out/people_front/checkpoint.pt --back out/people_back/checkpoint.pt \
		--picture docs/training.png

# From nothing: what stands from an earlier checkout proves nothing about this one.
smoke: $(READY)
	rm -rf out/smoke
	$(BIN)/python pipeline.py build --config configs/smoke.yaml --output out/smoke
	$(BIN)/python pipeline.py verify out/smoke

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --disable-pip-version-check \
		-e '.[render,humans,figures,dev]'
	touch $@

$(TESTABLE): $(READY)
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --disable-pip-version-check \
		-e '.[smplx,trainer,surface,poisson,dask,stores]'
	touch $@

clean:
	rm -rf .venv out
