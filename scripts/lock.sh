#!/bin/sh
# Write the locks anew: the newest versions that fit pyproject.toml, with the digests of all their wheels.
# requirements.lock is what a user needs, requirements-dev.lock that and what tests, docs and lint need besides.
# Each serves every supported Python and names no place to download from. `scripts/lock.sh --keep` keeps the versions.
set -eu
cd "$(dirname "$0")/.."
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"${PYTHON:-python3}" -m venv "$scratch/venv"
"$scratch/venv/bin/python" -m pip install --quiet --only-binary :all: uv
keep=
if [ "${1:-}" = --keep ]; then

    sed -n 's/^\([a-z0-9.-]*==[^ ]*\).*/\1/p' requirements-dev.lock >"$scratch/known"
    keep="--constraint $scratch/known"
fi

compile() {
    file=$1
    shift
    {
        echo "# Written by \`make lock\`; every version is tested together."
        # shellcheck disable=SC2086
        "$scratch/venv/bin/uv" pip compile pyproject.toml --universal --python-version 3.11 --only-binary :all: \
            --generate-hashes --no-header --no-annotate --quiet $keep "$@"
    } >"$scratch/$file"
}

compile requirements-dev.lock --all-extras --group install --group dev
sed -n 's/^\([a-z0-9.-]*==[^ ]*\).*/\1/p' "$scratch/requirements-dev.lock" >"$scratch/same"
keep="--constraint $scratch/same"
compile requirements.lock --extra all --group install
mv "$scratch/requirements.lock" "$scratch/requirements-dev.lock" .
