"""Make the recordings of data/synthetic anew from their recipes: `python -m scripts.synthetic_data [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

from workbench.errors import InputError, WorkbenchError
from workbench.synthetic.simulate import simulate_file


def make_library(folder: str | Path) -> list[Path]:
    """Simulate every recipe `NAME.json` in `folder` into `NAME.h5` and `NAME.truth.json`; the recordings made."""
    recipes = recipes_in(folder)
    if not recipes:
        raise InputError(str(folder), "a folder with recipes, NAME.json")
    made = [recipe.with_suffix(".h5") for recipe in recipes]
    for recipe, recording in zip(recipes, made, strict=True):
        simulate_file(recipe, recording)
    return made


def recipes_in(folder: str | Path) -> list[Path]:
    """The recipes of a folder: its JSON files but the truths."""
    return sorted(path for path in Path(folder).glob("*.json") if not path.name.endswith(".truth.json"))


def main(arguments: list[str]) -> int:
    """The command: one line a recording; exit status 2 where the recipes or the folder are unusable."""
    try:
        for recording in make_library(arguments[0] if arguments else "data/synthetic"):
            print(recording)
    except WorkbenchError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
