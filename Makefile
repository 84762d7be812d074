# Needs python3 >= 3.11 with venv and pip, and make; nothing else.
PYTHON ?= python3
BIN := .venv/bin
JOBS ?= 2
OUT ?= reports/local
# a file's tests in one process, which builds what they share once
BESIDE := -n $(JOBS) --dist loadfile --no-loadscope-reorder
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.PHONY: bench publish field report docs test test-all test-long fuzz check verify certificates lint drawings setup clean

bench: setup           ## run the suite `quick`, write reports/local/, and tell what differs from what is published
	$(BIN)/gauss-bench run --report --jobs $(JOBS) --against reports

COMMITTED = @changed=$$(git status --porcelain -- . ':!reports') && test -z "$$changed" || \
	  { echo "$@: only what is committed is published; changed:" >&2; echo "$$changed" >&2; exit 2; }

publish: setup         ## run the suites `full` and `field` and write reports/, from a committed tree alone
	$(COMMITTED)
	$(BIN)/gauss-bench run --suite full --jobs $(JOBS) --out reports
	$(MAKE) field

field: setup           ## run the suite `field` alone into reports/field/, and write the pages of reports/ again, likewise
	$(COMMITTED)
	$(BIN)/gauss-bench run --suite field --jobs $(JOBS) --out reports/field
	$(BIN)/python -m gauss_bench.report.field_run reports/field
	$(BIN)/gauss-bench report --out reports
	$(BIN)/python -m gauss_bench.report.pictures reports README.md
	$(BIN)/python -m gauss_bench.report.citation reports CITATION.cff

report: setup          ## write the summary and the site of OUT again from its tables
	$(BIN)/gauss-bench report --out $(OUT)

docs: setup            ## write the documentation into the site of OUT; a report written after it links to it
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet -f gauss_bench/docs/mkdocs.yml -d $(abspath $(OUT))/site/docs

test: setup            ## the tests that take no time and no tools
	$(BIN)/python -m pytest -m "not slow and not long" $(BESIDE)

test-all: setup        ## those, and the slow ones: a browser, a C compiler, fuzzing
	$(BIN)/python -m pytest -m "not long" $(BESIDE)

test-long: setup       ## the same claims at length: every mutation, every engine, every linkage
	$(BIN)/python -m pytest -m long $(BESIDE)

FILES ?= 20000
LISTS ?= 3000
MOTIONS ?= 200
PROPERTIES ?= 300
JUDGED ?= 2000
SEED ?= 1
fuzz: setup            ## hostile files and arguments, motions, the judge and properties at length: make fuzz FILES=2000 PROPERTIES=1000 SEED=2
	$(BIN)/python -m tests.fuzz --files $(FILES) --lists $(LISTS) --motions $(MOTIONS) --properties $(PROPERTIES) \
		--judged $(JUDGED) --seed $(SEED)

check: setup           ## the accuracy gate
	$(BIN)/gauss-bench check --jobs $(JOBS)

verify: setup          ## the certified references, checked in double precision
	$(BIN)/gauss-bench verify --jobs $(JOBS)

certificates: setup    ## the certified references, made anew
	$(BIN)/gauss-bench certify --built-in --jobs $(JOBS)

lint: setup            ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

drawings: setup        ## the drawings of mechanisms/ from the linkage files
	for x in mechanisms/*.toml; do $(BIN)/gauss-bench show $$x --svg $${x%.toml}.svg --replace >/dev/null || exit 1; done

setup: .venv/.ready

.venv/.ready: constraints.txt pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --disable-pip-version-check --quiet --no-compile --require-hashes -r constraints.txt
	$(BIN)/pip install --disable-pip-version-check --quiet --no-compile --no-deps --no-build-isolation -e .
	touch $@

clean:                 ## remove the environment, caches and unfinished runs
	rm -rf .venv reports/.run reports/local .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
