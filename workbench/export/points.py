"""The points of an organised cloud as a table: base coordinates, face, frame and column."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Cloud, Edge
from workbench.errors import InputError
from workbench.units import AnyArray, Float, Int, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class PointTable:
    """n points, frame by frame."""

    position_mm: Shaped[Float, "n 3"]  # in the base
    face: Shaped[AnyArray, " n"]  # uint8, label as in artefacts.FACE_NAMES
    frame: Shaped[Int, " n"]
    column: Shaped[Int, " n"]


def point_table(cloud: Cloud, edge: Edge | None, frames: Int | None = None) -> PointTable:
    """The kept points of the cloud, of all frames or of some; all unlabelled without an edge.

    Raises InputError where nothing is left, or where the edge is not that cloud's.
    """
    keep = cloud.keep if frames is None else cloud.keep[frames]
    if edge is not None and edge.labels.shape != cloud.keep.shape:
        raise InputError("edge", f"expected labels of the cloud's {cloud.keep.shape} grid, found {edge.labels.shape}")
    row, column = np.nonzero(keep)
    frame = row if frames is None else frames[row]
    if frames is None and not frame.size:
        raise InputError(cloud.source, "expected points to write, the cloud has none left")
    position = cloud.placed(frame, column)
    face = np.zeros(frame.size, np.uint8) if edge is None else edge.labels[frame, column]
    return PointTable(position, face, frame, column)
