#!/bin/sh
# Make or update the environment .venv with exactly the pinned packages, then the project itself.
# Usage: scripts/set_up.sh run|dev|bench, from the project's root. `dev` holds all of `run`; `bench` adds to a whole `dev`.
# .venv/.run and .venv/.dev are written last: without them an environment is taken for half made, and made anew.
set -eu
level=${1:?usage: scripts/set_up.sh run|dev|bench}
venv=.venv
python=$(sh scripts/find_python.sh)

# An environment of another checkout or another user must not direct this one.
unset PYTHONPATH PYTHONHOME VIRTUAL_ENV CONDA_PREFIX PIP_TARGET PIP_PREFIX PIP_USER PIP_REQUIRE_VIRTUALENV 2>/dev/null || true

whole() { [ -e "$venv/.run" ] && "$venv/bin/python" -c 'import numpy' >/dev/null 2>&1; }

if command -v uv >/dev/null 2>&1; then
    create() { uv venv --quiet --no-project --python "$python" "$venv"; }
    install() { uv pip install --quiet --python "$venv/bin/python" "$@"; }
else
    create() { "$python" -m venv "$venv"; }
    install() { "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-input "$@"; }
fi

if [ "$level" = bench ]; then
    [ -e "$venv/.dev" ] || { echo "$venv is not whole; run make .venv/.dev first" >&2; exit 1; }
    echo "adding the peers that make bench measures to $venv"
    install --require-hashes --only-binary=:all: -r requirements/bench.txt
    touch "$venv/.bench"
    exit 0
fi

if whole; then
    echo "updating $venv ($level)"
    [ "$level" = dev ] || [ ! -e "$venv/.dev" ] || level=dev
    rm -f "$venv/.run" "$venv/.dev"
else
    echo "making $venv ($level) with $python; this takes a minute or two the first time"
    rm -rf "$venv"
    create
fi

install --require-hashes --only-binary=:all: -r "requirements/$level.txt"
install --no-deps --no-build-isolation --editable .
touch "$venv/.run"
[ "$level" = run ] || touch "$venv/.dev"
