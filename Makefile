# `make demo` and `make test` do all the set-up on a fresh machine with Python 3.10 or newer.
PYTHON ?= python3
VENV := .venv
DEMO_VENV := .venv-demo
RELEASE_VENV := .venv-release
# CPU torch, named in the command that installs what needs it: a range alone would bring the GPU build.
TORCH := torch==2.13.0
PRETTIER := npx --yes prettier@3.10.1
SCRIPTS := "**/*.{js,mjs}"

.PHONY: help demo page pictures dev test test-slow test-ranges fuzz lint format export reference docs golden release clean

help:  ## what there is to make
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

demo: $(DEMO_VENV)/.installed  ## real stereo photos to a .tsplat file and back, pictures in demo_out/ (no torch)
	$(DEMO_VENV)/bin/python examples/demo.py --out demo_out

page: $(VENV)/.installed  ## smaller scripts for pages, once JavaScript has changed (needs npm): runtime/tinysplat_runtime/page/small.json.gz
	$(VENV)/bin/python checks/page_scripts.py

pictures: $(VENV)/.installed  ## the command that makes each picture of the pages, and which are older than what they show
	$(VENV)/bin/python checks/pictures.py

dev: $(VENV)/.installed  ## the development environment

test: $(VENV)/.installed  ## the tests, on all cores (under 15 minutes on 2); "deselected" are those of test-slow
	TINYSPLAT_ALL_EXTRAS=1 $(VENV)/bin/python -m pytest -q -m "not slow" -n auto --dist worksteal

test-slow: $(VENV)/.installed  ## the tests that take minutes each
	$(VENV)/bin/python -m pytest -q -m slow

# The chain from the command line, the container, x265 and libavcodec through PyAV, Gaussian files, both ways to draw.
RANGE_TESTS := $(addprefix tests/, e2e/test_cli.py container/test_table.py codec/test_hevc.py codec/test_recode.py \
	system/test_files.py formats/test_formats.py formats/test_ply.py render/test_extremes.py render/test_rasteriser.py)

test-ranges: $(VENV)/.installed  ## the runtime at the oldest and newest versions of what it depends on (needs the network)
	$(VENV)/bin/python -m pip install -q uv
	set -e; for end in lowest-direct highest; do \
	  $(VENV)/bin/uv venv -q --clear build/$$end; \
	  $(VENV)/bin/uv pip install --only-binary :all: --no-binary tinysplat --python build/$$end \
	    --resolution $$end -e ".[io,fast]"; \
	  $(VENV)/bin/uv pip install -q --python build/$$end "pytest<10" pytest-timeout hypothesis; \
	  build/$$end/bin/python -m pytest -q -p no:cacheprovider -W default $(RANGE_TESTS); \
	done

fuzz: $(VENV)/.installed  ## the whole fuzz campaign: 1.9 million damaged files, about 40 minutes of one core
	PYTHONPATH=tests $(VENV)/bin/python -m hostile.campaign

lint: $(VENV)/.installed  ## ruff and mypy, and where there is npm prettier and tsc for JavaScript
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	! command -v npx >/dev/null || $(PRETTIER) --check $(SCRIPTS)
	! command -v npx >/dev/null || npx --yes --package typescript@5.9.3 tsc -p jsconfig.json
	! command -v npx >/dev/null || npx --yes --package typescript@5.9.3 tsc -p checks/types/web.json

format: $(VENV)/.installed  ## rewrite in the project's style
	$(VENV)/bin/ruff check --fix .
	$(VENV)/bin/ruff format .
	! command -v npx >/dev/null || $(PRETTIER) --write --log-level warn $(SCRIPTS)

export: $(VENV)/.installed  ## write models/*.onnx and their manifest anew
	$(VENV)/bin/python -m export.transforms
	$(VENV)/bin/python -m export.enlarge
	$(VENV)/bin/python -m export.network sweep
	$(VENV)/bin/python -m export.network edge --half-weights
	$(VENV)/bin/python -m export.optimised edge
	$(VENV)/bin/python -m export.stages

reference: $(VENV)/.installed  ## docs/CLI.md and docs/API.md anew, of parsers and docstrings
	$(VENV)/bin/python docs/reference.py

docs: $(VENV)/.installed docs/assets/iframe-worker-shim.js  ## the documentation site in site/, for a server or opened from disk
	$(VENV)/bin/python -m pip install -q -e ".[docs]"
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/python -m mkdocs build --strict

docs/assets/iframe-worker-shim.js:  # MIT, by npm: search in pages opened from disk
	mkdir -p $(@D)
	cd $(@D) && npm pack --silent iframe-worker@1.0.4 && tar -xzf iframe-worker-1.0.4.tgz package/shim/index.js
	mv $(@D)/package/shim/index.js $@ && rm -r $(@D)/package $(@D)/iframe-worker-1.0.4.tgz

golden: $(VENV)/.installed  ## rewrite golden files, messages and contracts, and print what changed; a reviewed decision, with its reason in the changelog
	$(VENV)/bin/python tests/golden/regenerate.py

release: $(RELEASE_VENV)/.installed  ## dist/: wheel and sdist, equal in two builds, bill of materials, checksums (no torch)
	$(RELEASE_VENV)/bin/python .ci/release.py

$(VENV)/.installed: pyproject.toml
	test -x $(VENV)/bin/python || $(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install -q --upgrade pip
	$(VENV)/bin/python -m pip install -q $(TORCH) -e ".[dev]"
	touch $@

$(DEMO_VENV)/.installed: pyproject.toml
	test -x $(DEMO_VENV)/bin/python || $(PYTHON) -m venv $(DEMO_VENV)
	$(DEMO_VENV)/bin/python -m pip install -q --upgrade pip
	$(DEMO_VENV)/bin/python -m pip install -q -e ".[demo]"
	touch $@

$(RELEASE_VENV)/.installed: pyproject.toml
	test -x $(RELEASE_VENV)/bin/python || $(PYTHON) -m venv $(RELEASE_VENV)
	$(RELEASE_VENV)/bin/python -m pip install -q --upgrade pip
	$(RELEASE_VENV)/bin/python -m pip install -q -e ".[release]"
	touch $@

clean:  ## remove environments and outputs
	rm -rf $(VENV) $(DEMO_VENV) $(RELEASE_VENV) demo_out site build dist *.egg-info
