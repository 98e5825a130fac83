# revline. On a fresh machine with python3 and make: `make study`, `make workbench` and `make test`.

BIN := .venv/bin
OUT := out
PAGE := src/revline/web/page/index.html
PAGE_SOURCES := $(shell find page -type f -not -path 'page/node_modules/*' -not -path 'page/tests/*')

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
$(if $(SIDE_BY_SIDE),,.NOTPARALLEL:)
PHONY_PAGE := page workbench wheel page-check screenshots
.PHONY: $(PHONY_PAGE) help study test check style types architecture docs acceptance bench lock clean

help: ## Show these commands.
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1|\2/p' Makefile | while IFS='|' read -r name text; do printf '%-20s %s\n' "$$name" "$$text"; done

study: .venv/.run ## Reproduce the whole study of Lee (1995) into ./out.
	$(BIN)/revline study --out $(OUT)

workbench: .venv/.run $(PAGE) ## Start the workbench and open it in a browser.
	$(BIN)/revline serve

page: $(PAGE) ## Build the workbench's page.

$(PAGE): $(PAGE_SOURCES) scripts/build_page.sh | .venv/.run
	@sh scripts/build_page.sh build
	@touch $@

wheel: .venv/.dev $(PAGE) ## Make a wheel with the page in it, into ./dist.
	$(BIN)/python -m hatchling build -t wheel -d dist

test: .venv/.dev $(PAGE) ## Run every test, on all processors, the examples in code and pages among them.
	$(BIN)/python -m pytest --numprocesses auto --dist loadscope --no-loadscope-reorder

# CI runs `make test` and then `make check TESTED=yes`, so that nothing runs twice. The tests use all processors by themselves; the rest runs
# side by side once the environment stands, each with its output in one piece.
CHECKS := acceptance docs types style architecture page-check
check: .venv/.dev $(if $(TESTED),,test) ## Run all that CI runs: style, types, layers, tests, docs, study, acceptance.
	@$(MAKE) --no-print-directory --jobs $(shell nproc) --output-sync=target SIDE_BY_SIDE=yes $(CHECKS)

style: .venv/.dev ## Check format, lint and spelling.
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/codespell

types: .venv/.dev ## Check types.
	$(BIN)/mypy

architecture: .venv/.dev ## Check the layers.
	$(BIN)/lint-imports

page-check: .venv/.dev $(PAGE) ## Check format, types and units of the page's sources.
	@sh scripts/build_page.sh check

screenshots: .venv/.dev $(PAGE) ## Take pictures of the workbench in its main states, into ./out/screenshots.
	$(BIN)/python docs/take_screenshots.py $(OUT)/screenshots

docs: .venv/.dev ## Build the documentation into docs/_build/html.
	$(BIN)/python -m sphinx -n -W --keep-going -q -b html docs docs/_build/html

acceptance: .venv/.dev $(if $(SIDE_BY_SIDE),study) ## Check the study in ./out and every command against published and converged values.
	$(BIN)/python tests/acceptance/check_study.py $(OUT)
	$(BIN)/python tests/acceptance/check_commands.py $(BIN)/revline --self-test
	$(BIN)/python tests/acceptance/check_serve.py $(BIN)/revline --self-test

bench: .venv/.bench ## Measure speed, also of peers; see benchmarks/.
	$(BIN)/python -m pytest benchmarks --benchmark-enable --benchmark-only
	set -e; for script in $(wildcard benchmarks/*_against_*.py) benchmarks/study_times.py; do $(BIN)/python $$script; done

lock: .venv/.dev ## Write requirements/ anew from pyproject.toml.
	sh scripts/lock.sh $(BIN)/uv

clean: ## Remove what was made: environment, results, caches.
	rm -rf .venv $(OUT) docs/_build page/node_modules src/revline/web/page .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache .benchmarks build dist
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +

# `dev` holds all of `run`, so an environment with .venv/.dev also has .venv/.run.
.venv/.run: requirements/run.txt pyproject.toml scripts/set_up.sh scripts/find_python.sh
	@sh scripts/set_up.sh run

.venv/.dev: requirements/run.txt requirements/dev.txt pyproject.toml scripts/set_up.sh scripts/find_python.sh
	@sh scripts/set_up.sh dev

# What benchmarks alone need; nothing else may depend on it.
.venv/.bench: .venv/.dev requirements/bench.txt
	@sh scripts/set_up.sh bench
