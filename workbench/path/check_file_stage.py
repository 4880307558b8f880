"""`path.check_file`: may a path out of a file be run? By what the file says of its check, and by the path itself."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import PathGate, Toolpath
from workbench.geometry.distances import line_distances
from workbench.path.check_stage import (
    HEIGHT_MM,
    PENETRATION_MM,
    cutter_faults,
    decision,
    entered,
    insane,
    weakened,
)
from workbench.path.feed_stage import face_lines, moves_in_order
from workbench.path.read_stage import PLACE_UNSAID
from workbench.stage import stage

ALONE = "the workpiece. Its file records no check against a scan; the path was compared with its own final layer"


@stage("path.check_file")
def check_file(
    toolpath: Toolpath,
    *,
    penetration_mm: Annotated[float, Field(gt=0, le=2)] = PENETRATION_MM,
) -> PathGate:
    """Check a path from a file, without a scan.

    A path that its file says was refused or changed stays refused. Layers step down to the final one, and the cutter is
    nowhere deeper than `penetration_mm` in the final face. Without a check in the file the programs say that the
    workpiece was not examined; without evidence of where the part stands the path is a shape only.

    Args:
        toolpath: the path.
        penetration_mm: how deep the cutter may enter the bevel that the final layer leaves.

    Example:
        >>> from workbench import path
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> path.check_file(plan).reason
        'path checked: 5 layers, 855 points'
    """
    claim = toolpath.claim
    claims = [f"its file says: {claim.reason}"] if claim and not claim.passed else []
    loosened = (*(claim.loosened if claim else (PLACE_UNSAID,)), *weakened(penetration_mm))
    return decision(
        toolpath,
        chain(claims, _own_faults(toolpath, penetration_mm)),
        penetration_mm,
        loosened,
        claim.unchecked if claim else (ALONE,),
    )


def _own_faults(toolpath: Toolpath, penetration_mm: float) -> Iterator[str]:
    """What the path says against itself."""
    faults = [*insane(toolpath), *cutter_faults(toolpath)]
    yield from faults
    if faults:
        return
    heights = [layer.height_mm for layer in toolpath.layers]
    if (np.diff(heights) >= 0).any() or abs(heights[-1]) > HEIGHT_MM:
        yield "layers do not step down to the final one"
    if penetration_mm >= toolpath.cutter.radius_mm:
        yield "the cutter is thinner than what it may enter: it cannot be checked"
        return
    face = face_lines(toolpath, toolpath.layers[-1])
    if face is None:
        yield "the final layer cuts nothing"
        return
    for points, _ in moves_in_order(toolpath):
        yield from entered(toolpath, points, partial(line_distances, face), penetration_mm, "the finished bevel")
