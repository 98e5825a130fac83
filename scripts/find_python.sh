#!/bin/sh
# Print the command of a Python that revline runs on (3.11 to 3.13, able to make environments).
# Where there is none, say what is missing and the one line that installs it, and exit with 1.
set -u

suits='import sys; sys.exit(not ((3, 11) <= sys.version_info[:2] <= (3, 13)))'
version='import sys; print("%d.%d" % sys.version_info[:2])'

have_uv() { command -v uv >/dev/null 2>&1; }

able() { have_uv || "$1" -c 'import venv, ensurepip' >/dev/null 2>&1; }

suited=
for candidate in python3 python3.13 python3.12 python3.11; do
    "$candidate" -c "$suits" >/dev/null 2>&1 || continue
    if able "$candidate"; then
        "$candidate" -c 'import sys; print(sys.executable)'
        exit 0
    fi
    suited=${suited:-$candidate}
done

# Nothing suits as it is: say why, and how to mend it in one line.
as_root=
[ "$(id -u)" = 0 ] || as_root='sudo '
if [ -n "$suited" ]; then
    package=python$("$suited" -c "$version")-venv
    [ "$suited" = python3 ] && package=python3-venv
    why="$suited cannot make environments: its module ensurepip is missing"
elif python3 -c "$version" >/dev/null 2>&1; then
    package='python3.11 python3.11-venv'
    why="python3 is $(python3 -c "$version"); revline runs on 3.11 to 3.13"
else
    package='python3 python3-venv'
    why='there is no python3'
fi
if command -v apt-get >/dev/null 2>&1; then
    remedy="${as_root}apt-get install -y $package"
else
    remedy="install $package with this system's package manager"
fi
printf '%s. Mend it with:\n%s\n' "$why" "$remedy" >&2
exit 1
