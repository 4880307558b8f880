"""`twin.part`: a raw part, before it is milled."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from workbench.errors import InputError
from workbench.stage import InputFile, stage
from workbench.synthetic import read_recipe
from workbench.synthetic.workpiece import Workpiece


@stage("twin.part")
def part(
    *,
    recipe: InputFile,
    part_id: Annotated[str | None, Field(max_length=200)] = None,
) -> Workpiece:
    """Put the raw part of a recipe on the table of the simulated cell (docs/simulation.md).

    The recipe also has the scanner, the robot's motion and the disturbances.

    Args:
        recipe: a recipe as for `workbench simulate`, its part of the kind `raw`.
        part_id: of the part, for results and reports; null: the recipe's.

    Raises:
        InputError: the file is no recipe, or the recipe of a part that is milled already.

    Example:
        >>> from workbench import twin
        >>> part = twin.part(recipe="data/synthetic/raw_edge.json")
        >>> type(part).__name__
        'Workpiece'
    """
    found = read_recipe(recipe)
    if found.part.kind != "raw":
        raise InputError(f"{recipe}: part.kind", f"'raw', a part that is still to be milled, not '{found.part.kind}'")
    return Workpiece(found if part_id is None else found.model_copy(update={"part_id": part_id}))
