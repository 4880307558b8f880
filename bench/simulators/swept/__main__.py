"""`python -m bench.simulators.swept RECIPE.json --out FILE.h5`: a recording of the swept simulator, and its truth."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from bench.simulators.swept import simulate_swept_file
from workbench.errors import WorkbenchError


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.simulators.swept", description=__doc__)
    parser.add_argument("recipe", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    try:
        simulate_swept_file(given.recipe, given.out)
    except WorkbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
