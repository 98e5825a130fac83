#!/bin/sh
# Write requirements/*.txt from pyproject.toml: exact versions and hashes for Python 3.11 to 3.13, and no host names.
# Usage: scripts/lock.sh UV, run from the project's root. Give LOCK_OPTIONS=--upgrade to raise versions.
set -eu
uv=${1:?usage: scripts/lock.sh UV}

compile() {
    target=$1
    shift
    # shellcheck disable=SC2086 # LOCK_OPTIONS holds several words
    "$uv" --no-config pip compile --quiet --universal --generate-hashes --python-version 3.11 --fork-strategy fewest \
        --no-emit-index-url --no-emit-find-links --no-header --no-annotate ${LOCK_OPTIONS:-} --output-file "$target" "$@"
    sed -i '1i # Written by make lock from pyproject.toml; not edited by hand.' "$target"
    if grep -nE '(https?|file)://|--(index-url|extra-index-url|find-links|trusted-host)' "$target"; then
        echo "$target names a host; it must not" >&2
        exit 1
    fi
}

compile requirements/run.txt pyproject.toml --extra report --extra web --group build
compile requirements/dev.txt pyproject.toml --extra report --extra web --extra control --group dev --constraint requirements/run.txt
compile requirements/bench.txt pyproject.toml --group bench --constraint requirements/dev.txt
compile requirements/page.txt --group page
