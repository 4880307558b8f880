"""`twin.teach`: points that an operator taught along the edge of the simulated part."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import TaughtEdge
from workbench.stage import Seed, stage
from workbench.synthetic.workpiece import Workpiece, build_surface, edge_frames, pose


@stage("twin.teach")
def teach(
    workpiece: Workpiece,
    *,
    distance_mm: Annotated[float, Field(ge=5, le=1000)] = 50.0,
    error_mm: Annotated[float, Field(ge=0, le=10)] = 0.3,
    seed: Seed = 1,
) -> TaughtEdge:
    """Teach points along the part's lower edge, as an operator with a pointer would: roughly, for `scan.plan`.

    Args:
        workpiece: the part as it is now.
        distance_mm: between points, at most.
        error_mm: standard deviation of a point, each axis.
        seed: of the errors.

    Example:
        >>> from workbench import twin
        >>> taught = twin.teach(twin.part(recipe="data/synthetic/raw_edge.json"))
        >>> taught.points_mm.shape
        (3, 3)
    """
    part = workpiece.recipe.part
    surface = build_surface(part, workpiece.recipe.seed)
    count = max(2, int(np.ceil(part.length_mm / distance_mm)) + 1)
    frames = pose(part.base_from_part) @ edge_frames(surface, np.linspace(0.0, part.length_mm, count))
    points = frames[:, :3, 3] + np.random.default_rng([seed, 0x7EAC]).normal(0.0, error_mm, (count, 3))
    return TaughtEdge(points, frames[:, :3, 2].mean(axis=0), "points that were taught")
