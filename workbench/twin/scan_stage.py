"""`twin.scan`: the simulated scanner over the workpiece as it is now."""

from __future__ import annotations

import dataclasses
from typing import Annotated

from pydantic import Field

from workbench.artefacts import PlannedScan, Recording
from workbench.stage import stage
from workbench.synthetic.recipe import Recipe, Scanner
from workbench.synthetic.simulate import scan_workpiece
from workbench.synthetic.workpiece import Workpiece

Length = Annotated[float, Field(ge=-1000, le=1000)]


@stage("twin.scan")
def scan(
    workpiece: Workpiece,
    plan: PlannedScan | None = None,
    *,
    elevation_deg: Annotated[
        float | None,
        Field(gt=-90, lt=90),
    ] = None,
    aim_mm: tuple[Length, Length] | None = None,
) -> Recording:
    """Scan the workpiece as it is now, with the scanner, passes and robot of its recipe (docs/simulation.md).

    A planned scan (`scan.plan`) brings its passes and its profiler. After each milling all
    random numbers but those of the hand-eye calibration are new.

    Args:
        workpiece: the part as it is now.
        plan: the scan that is followed; None: the recipe's passes.
        elevation_deg: of the sensor above the end face's normal in every pass; null: as the recipe says.
        aim_mm: aim point (h, z) in the section: outwards from the lower edge, and up; null: as the recipe says.

    Example:
        >>> from workbench import twin
        >>> part = twin.part(recipe="data/synthetic/raw_edge.json")
        >>> recording = twin.scan(part)
        >>> recording.x_mm.shape
        (301, 600)
    """
    recipe = workpiece.recipe
    if plan is not None:
        led = dataclasses.replace(workpiece, recipe=recipe.model_copy(update={"scanner": _planned_for(plan, recipe)}))
        made = scan_workpiece(led, plan.courses)[0]
        return dataclasses.replace(made, part=dataclasses.replace(made.part, scan_plan=plan.plan_id))
    changed = {
        name: value for name, value in (("elevation_deg", elevation_deg), ("aim_mm", aim_mm)) if value is not None
    }
    passes = tuple(one.model_copy(update=changed) for one in recipe.passes)
    aimed = dataclasses.replace(workpiece, recipe=recipe.model_copy(update={"passes": passes}))
    return scan_workpiece(aimed)[0]


def _planned_for(plan: PlannedScan, recipe: Recipe) -> Scanner:
    """The profiler of a plan; what its file does not tell is the recipe's."""
    own = recipe.scanner
    near, far = plan.range_mm
    planned = {
        "columns": plan.columns,
        "pitch_mm": plan.pitch_mm,
        "standoff_mm": plan.standoff_mm,
        "near_mm": near,
        "far_mm": far,
        "baseline_mm": own.baseline_mm if plan.camera_mm is None else plan.camera_mm,
        "noise": own.noise.model_copy(update={"sd_mm": plan.noise_mm}),
        "z_away": plan.z_away,
        "x_rises": True,
        "zero_range_mm": 0.0,
        "x_offset_mm": 0.0,
    }
    return own.model_copy(update=planned)
