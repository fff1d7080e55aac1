# Two commands do it all on a fresh machine with Python >= 3.11: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DISTRIBUTIONS := $(wildcard packages/*/pyproject.toml)
EDITABLE := $(patsubst %/pyproject.toml,--editable %,$(DISTRIBUTIONS))
# One thread a library: the tests run side by side, and torch is slower with more.
export OMP_NUM_THREADS := 1
# The same of NumPy's functions and matrices, whatever the processor: the digest compares digits.
export NPY_DISABLE_CPU_FEATURES := X86_V4 AVX512_ICL
export OPENBLAS_CORETYPE := Haswell
# What Python compiles stays on disk, or each of the hundreds of processes would compile it again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check tests core docs install clean

demo: $(VENV)/installed  ## set up, train the 7x7 trio and the baseline, print and draw
	$(BIN)/socialiq demo

test:  ## what a change must pass: checks, then every test that is quick and needs no extra
	$(MAKE) --jobs 2 check tests

check: $(VENV)/installed-dev  ## lint, types, layers, spelling and plain words (docs/words.txt)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports
	$(BIN)/codespell packages studies docs tests examples benchmarks *.md

# Programs that JAX compiled in one run serve the next: compiling is most of the learners' tests.
tests: export JAX_COMPILATION_CACHE_DIR ?= $(CURDIR)/build/compiled
tests: core  ## the quick tests, shapes checked at run time, warnings as errors
	$(BIN)/pytest -n 2 --dist worksteal -m "not slow" --ignore tests/extras $(PYTEST)

# Numba keeps the compiled intersection on disk, with the world without the ego. Without it there,
# both workers of pytest would compile it at the same time, a minute each.
core: $(VENV)/installed-dev
	$(BIN)/python -c "from socialiq.worlds import registry; registry.make('intersection-caused').batch(1).reset(0)"

docs: $(VENV)/installed-docs  ## the documentation's site, in build/site; a warning is an error
	$(BIN)/sphinx-build --jobs auto --fail-on-warning --keep-going --quiet docs build/site

install: $(VENV)/installed

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

$(VENV)/installed: $(VENV)/bin/python $(DISTRIBUTIONS) constraints.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt $(EDITABLE)
	touch $@

$(VENV)/installed-dev: $(VENV)/bin/python $(DISTRIBUTIONS) constraints.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt $(EDITABLE) --editable 'packages/socialiq[dev]'
	touch $@ $(VENV)/installed

$(VENV)/installed-docs: $(VENV)/bin/python $(DISTRIBUTIONS) constraints.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt $(EDITABLE) --editable 'packages/socialiq[docs]'
	touch $@ $(VENV)/installed

clean:
	rm -rf .venv .venv-full build/compiled
