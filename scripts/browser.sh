#!/bin/sh
# A Chromium for the tests of the report's 3-D, if there is none and it may be installed; tried once. Never fails: the
# tests say themselves why they are skipped.
cd "$(dirname "$0")/.." || exit 0
. scripts/install_packages.sh

for name in chromium chromium-browser google-chrome; do
    command -v $name >/dev/null && exit 0
done
[ ! -e .venv/browser-tried ] || exit 0
: >.venv/browser-tried
install_packages chromium || echo "setup: the report's 3-D is not tested in a browser; apt-get install chromium (as root) for that" >&2
exit 0
