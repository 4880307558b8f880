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
$python - "$scratch/report.json" >"$scratch/lock" <<'END'
import json, sys, tomllib
print("# Written by `make lock`; every version is tested together.")
groups = tomllib.load(open("pyproject.toml", "rb"))["dependency-groups"]
marked = {line.split(">=")[0]: " ;" + line.partition(";")[2] for line in groups["dev"] if ";" in line}  # not for every Python
packages = {p["metadata"]["name"].lower().replace("_", "-"): p["metadata"]["version"] for p in json.load(open(sys.argv[1]))["install"]}
print("\n".join(f"{name}=={version}{marked.get(name, '')}" for name, version in sorted(packages.items()) if name != "workbench"))
END
mv "$scratch/lock" requirements.lock
