#!/bin/sh
# Write requirements.lock anew: the newest versions that fit pyproject.toml, as plain name==version lines.
# The one file serves every supported Python and names no place to download from.
set -eu
cd "$(dirname "$0")/.."
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"${PYTHON:-python3}" -m venv "$scratch/venv"
python="$scratch/venv/bin/python"
$python -m pip install --quiet --upgrade pip
$python -m pip install --quiet --only-binary :all: --dry-run --ignore-installed --report "$scratch/report.json" . --group dev
$python scripts/write_lock.py "$scratch/report.json" >"$scratch/lock"
mv "$scratch/lock" requirements.lock
