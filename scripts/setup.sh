#!/bin/sh
# Make .venv with everything that workbench needs: `setup.sh`, or with what its tests, docs and lint need too: `setup.sh dev`.
# Does nothing where nothing is to do; one that was interrupted goes on. --yes (or YES=1) lets it use sudo unasked.
# PYTHON=/path/to/python chooses the interpreter; otherwise python3 if it will do, else the newest that will.
set -eu
cd "$(dirname "$0")/.."
. scripts/install_packages.sh

# The Pythons for which every package in requirements.lock has a wheel.
OLDEST=11
NEWEST=14

part=user lock=requirements.lock
for argument in "$@"; do
    case $argument in
        dev) part=dev lock=requirements-dev.lock ;;
        --yes) YES=1 ;;
        *) echo "setup: expected dev or --yes, got $argument" >&2; exit 1 ;;
    esac
done

fail() {
    echo "setup: $*" >&2
    exit 1
}

# Prints the version of the interpreter $1 if it runs at all.
version_of() {
    "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null
}

will_do() {
    version=$(version_of "$1") || return 1
    [ "${version%%.*}" = 3 ] && [ "${version#3.}" -ge $OLDEST ] && [ "${version#3.}" -le $NEWEST ]
}

choose_python() {
    wanted="Python 3.$OLDEST to 3.$NEWEST"
    if [ -n "${PYTHON:-}" ]; then
        will_do "$PYTHON" || fail "$wanted needed, but PYTHON=$PYTHON is ${version:-not a Python that runs}"
        echo "$PYTHON"
        return
    fi
    found=
    for candidate in python3 python3.14 python3.13 python3.12 python3.11; do
        will_do $candidate && { command -v $candidate; return; }
        [ -z "$version" ] || found="${found:+$found, }$candidate is $version"
    done
    fail "$wanted needed, found: ${found:-none}; name another with PYTHON=..."
}

# Debian packages that are missing: shared libraries, and the module that makes virtual environments.
missing_packages() {
    "$1" scripts/system_libraries.py "$part"
    [ -x .venv/bin/pip ] || "$1" -c 'import ensurepip, venv' 2>/dev/null ||
        echo "python$(version_of "$1")-venv"
}

provide_packages() {
    # shellcheck disable=SC2046
    set -- "$1" $(missing_packages "$1")
    python=$1
    shift
    [ $# -gt 0 ] || return 0
    install_packages "$@" || fail "needed first: apt-get install $* (as root)"
    left=$(missing_packages "$python" | tr '\n' ' ')
    [ -z "$left" ] || fail "still missing after installing: $left"
}

up_to_date() {
    [ -x .venv/bin/workbench ] && [ .venv/complete -nt $lock ] && [ .venv/complete -nt pyproject.toml ] &&
        [ .venv/complete -nt scripts/setup.sh ] && [ "$(cat .venv/complete)" = "$PWD" ] &&
        { [ $part = user ] || [ -e .venv/complete-dev ]; }
}

# A .venv that was begun, or moved together with its folder, is made anew.
is_usable() {
    will_do .venv/bin/python && [ -x .venv/bin/pip ] && [ "$(cat .venv/complete 2>/dev/null || pwd)" = "$PWD" ]
}

install_wheels() {
    [ ! -e .venv/complete-dev ] || lock=requirements-dev.lock
    echo "setup: installing the packages of $lock into .venv; the first time this takes some minutes"
    # What pip was writing when it was stopped has no RECORD yet, and counts as installed.
    for begun in .venv/lib/python3*/site-packages/*.dist-info; do [ -s "$begun/RECORD" ] || rm -rf "$begun"; done
    pip=".venv/bin/python -m pip --disable-pip-version-check"
    # Bytecode of all packages would take a third of the time; that of what is imported is kept when it is first.
    $pip install --quiet --no-compile --require-hashes --only-binary :all: --requirement $lock ||
        fail "the packages of $lock could not be installed, see above"
    $pip uninstall --quiet --yes workbench # as which it was installed up to 0.2
    $pip install --quiet --no-deps --no-build-isolation --editable .
    .venv/bin/python scripts/try_wheels.py || fail "a package of .venv does not work here, see above"
    [ $part = user ] || : >.venv/complete-dev
    pwd >.venv/complete
}

python=$(choose_python)
provide_packages "$python"
up_to_date && exit
is_usable || { rm -rf .venv && "$python" -m venv .venv; }
install_wheels
.venv/bin/python scripts/compile_kernels.py
echo "setup: done"
