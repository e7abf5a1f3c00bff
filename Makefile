# Two commands from a fresh machine: `make book` and `make test`. Each installs what it needs first.
# The same steps without make are in README.md.

# that of the environment; else 3.11 where it runs, 3.12 or 3.13: tried, since a name may be a shim of nothing
PYTHON  ?= $(shell for v in 11 12 13; do $(RUN) -c "import sys; sys.exit(sys.version_info[:2] != (3, $$v))" >/dev/null 2>&1 && \
    echo $(RUN) && exit; done; for v in 11 12 13; do for name in python3.$$v python3 python; do \
    $$name -c "import sys; sys.exit(sys.version_info[:2] != (3, $$v))" >/dev/null 2>&1 && echo $$name && exit; done; done)
VENV    := .venv
RUN     := $(VENV)/bin/python
INSWSN  := $(RUN) -I -X utf8 -m inswsn_book
COMPILE := $(RUN) -m uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header environment.in -o environment.lock
# a tool apart from the environment: what .ci/NAME.txt pins, in _build/NAME
tool     = $(found); $(PYTHON) -m venv _build/$(1) && \
    _build/$(1)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r .ci/$(1).txt
# and have it see what the locks hold
sees     = locked=$$(echo $(CURDIR)/$(VENV)/lib/python3.*/site-packages); cd _build/$(1)/lib/python3.*/site-packages && \
    echo "import sys, site; $(2)site.addsitedir('$$locked')" > locked.pth
found    = test -n "$(PYTHON)" || { echo "Python 3.11, 3.12 or 3.13 is needed, and none runs." >&2; exit 2; }
FRESH   ?=
JOBS    ?=
PORT    ?= 8000
LAB     ?=
# processes that run tests; each computes with one thread, and waits for pages and processes half of its time. One
# that has no tests left takes half of those that wait for another: files take too unlike a time to be dealt out whole.
WORKERS ?= 4

book: environment ## execute every chapter and render the book to _build/html (FRESH=1 ignores the cache)
	@$(INSWSN) book $(if $(FRESH),--fresh) $(if $(JOBS),--jobs $(JOBS))

test: environment ## lint, types, and all tests
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(VENV)/bin/lint-imports
	$(RUN) -m pytest -n $(WORKERS) --dist worksteal

library: environment ## the tests of the library alone, as they also pass by Python 3.12 and 3.13
	$(RUN) -m pytest -n $(WORKERS) --dist worksteal tests/lib

serve: book ## show the built book at http://127.0.0.1:$(PORT)/
	@echo "The book is at http://127.0.0.1:$(PORT)/ (stop with Ctrl-C)"
	@$(RUN) -m http.server --directory _build/html --bind 127.0.0.1 $(PORT) >/dev/null 2>&1

lab: environment _build/jupyter/made ## open copies of the chapters in JupyterLab, where figures move, too; LAB="--no-browser" gives it words
	@$(call sees,jupyter)
	@_build/jupyter/bin/python -X utf8 -m inswsn_book.lab $(LAB)

_build/jupyter/made: .ci/jupyter.txt
	@$(call tool,jupyter)
	@touch $@

notebooks: environment ## write the .ipynb twins of the chapters
	@$(RUN) -I -X utf8 -m inswsn_book.make.plain

publish: environment ## make the last build's results the reference in data/published, after showing what changes, and write the notebooks with them
	@$(INSWSN) publish
	@$(RUN) -I -X utf8 -m inswsn_book.make.plain
	@$(RUN) studies/front_picture.py

archive: book ## make one zip of the release that opens offline, in _build
	@$(RUN) -I -X utf8 -m inswsn_book.make.archive

pdf: book ## print the book to _build/pdf: lessons and evidence, claims, reference; needs Chromium
	@$(RUN) -I -X utf8 -m inswsn_book.make.volumes

# Version 1 of Jupyter Book may decay; the book does not need it. What its page of the library imports is what the
# lock holds, but for Jupyter Book.
sphinx: book ## render the built book by the newest Sphinx without Jupyter Book, to _build/sphinx/html; needs the network
	@$(found); $(PYTHON) -m venv --clear _build/sphinx
	@_build/sphinx/bin/python -m pip install --quiet --disable-pip-version-check -r .ci/sphinx.in
	@$(call sees,sphinx,sys.modules['jupyter_book'] = None; )
	@_build/sphinx/bin/python -I -X utf8 -m sphinx -q -W --keep-going -b html -d _build/sphinx/doctrees _build/pages/source _build/sphinx/html
	@$(RUN) .ci/same_pages.py _build/html _build/sphinx/html

calibrate: environment ## fit the simulated INS to the INS-only cells and write data/scenarios/p1-inertial*.yaml
	@$(RUN) studies/calibrate_imu.py

recorded: environment ## run the studies of recordings again: the drive, filters on recordings, fixes by radio
	@$(RUN) studies/recorded_drive.py
	@$(RUN) studies/on_recordings.py
	@$(RUN) studies/radio_fixes.py

studies: recorded ## the same, sensitivity to the assumptions, one at a time and crossed, and errors of fixes that last
	@$(RUN) studies/sensitivity.py
	@$(RUN) studies/lasting.py $(if $(JOBS),--jobs $(JOBS))
	@$(RUN) studies/crossed.py $(if $(JOBS),--jobs $(JOBS))

spoilt: environment ## spoil recordings by hundreds, and keep what is refused, found or passed in data/spoilt.json
	@OPENBLAS_NUM_THREADS=1 $(RUN) studies/spoilt.py

elsewhere: environment ## run every chapter in other surroundings, for the book's table
	@$(RUN) studies/elsewhere.py $(if $(JOBS),--jobs $(JOBS))

# Without the network the rows of the peers are left out.
bench: environment ## speed against peers, as ratios; writes data/benchmarks*.yaml and growth.json, for the book
	@($(call tool,bench)) || echo "The peers of .ci/bench.txt could not be installed." >&2
	@$(call sees,bench)
	@_build/bench/bin/python benchmarks/throughput.py
	@$(RUN) benchmarks/growth.py
	@$(RUN) benchmarks/kernels.py
	@$(RUN) benchmarks/vehicle.py

# Where the network has the wheel of numpy that Pyodide's makers built, that is taken; else it is built, which
# takes clang-16, lld-16, llvm-16 and npm of Debian 12. SOURCE=official or SOURCE=built takes that one alone.
wasm: environment ## make in _build/live what lets Python run in the reader's page, without a server
	@$(RUN) -X utf8 .ci/wasm.py $(if $(SOURCE),--source $(SOURCE)) $(if $(JOBS),--jobs $(JOBS))

live: wasm ## build the book with Python in it, now and from now on, so that code cells of lessons run where they are read (OFF=1: no longer)
	@$(RUN) -I -X utf8 -m inswsn_book.make.live $(if $(OFF),--off)

mutants: environment ## change the library 200 times a room, and tell how often its tests notice
	@$(RUN) studies/mutants.py filters lmi learning vehicle

# torch has a short lock of its own, changed by hand: its CPU wheel lives on an index of its own.
lock: environment ## compile environment.in to environment.lock; versions stay unless it excludes them
	@$(COMPILE) $(if $(UPGRADE),--upgrade)

upgrade: ## the same with the newest versions that environment.in allows
	@$(MAKE) lock UPGRADE=1

trials: environment ## try thousands of systems, files, commands, recordings and damages; writes data/trials.json
	INSWSN_TESTS=whole INSWSN_TRIALS=data/trials.json $(RUN) -m pytest -n $(WORKERS) --dist worksteal tests/trials

licences: environment ## list the licences of what the locks pin in THIRD-PARTY-PACKAGES.md
	@$(RUN) studies/licences.py

# TAG is left to the script, which takes it as it is: a name from outside may hold anything
tag: ## tell whether TAG=v2.0.0 names this version
	@.ci/release check

wheels: environment ## build the wheels of both packages in _build/wheels; twine checks what they say, which needs the network
	@rm -rf _build/wheels
	@$(RUN) -m pip wheel --quiet --no-deps --no-build-isolation --no-index --wheel-dir _build/wheels . ./book
	@$(call tool,twine)
	@$(call sees,twine)
	@_build/twine/bin/python -m twine --no-color check _build/wheels/*

assets: archive pdf wheels ## gather the files of a release in _build/release
	@.ci/release gather

# A workflow tests, builds, gathers and publishes in jobs of its own.
release: ## test all, build all, gather it in _build/release; PUBLISH=1 TAG=v3.0.0 publishes what was gathered, by gh
	@.ci/release $(if $(PUBLISH),publish,all)

report: ## say in an issue on the public host that the weekly run failed, by its command gh
	@.ci/report

# The package fetches the linter from the public host while it is installed; so it is not in the lock.
actionlint: ## check the workflow files by actionlint, installed into _build; needs the public host
	@$(call tool,actionlint)
	_build/actionlint/bin/actionlint -color

# The wheel of torch for CPUs has a version of its own, of which no list of vulnerabilities speaks.
audit: ## look for known vulnerabilities of what the locks pin, by pip-audit, installed into _build; needs the network
	@$(call tool,audit)
	@sed 's/+cpu//' environment-torch.lock > _build/audit/torch.txt
	_build/audit/bin/pip-audit --strict --require-hashes --disable-pip -r environment.lock -r _build/audit/torch.txt

format: environment ## put the code into the one format
	$(RUN) -m ruff check --fix .
	$(RUN) -m ruff format .

environment:
	@$(found); $(PYTHON) .ci/environment.py

clean: ## remove what was built; the environment stays
	rm -rf _build results

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "%-12s %s\n", $$1, $$2 }' Makefile

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: book test library serve lab notebooks publish archive sphinx calibrate recorded studies spoilt elsewhere bench wasm live pdf wheels mutants trials licences lock upgrade tag assets release report actionlint audit format environment clean help
