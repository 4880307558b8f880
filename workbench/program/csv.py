"""`program.csv`: the points of the path as a table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import Document, Layer, PathGate, RobotCell, Toolpath, Travel
from workbench.dialect import released
from workbench.stage import stage

HEADER = "layer,arc_length_mm,x_mm,y_mm,z_mm,qw,qx,qy,qz,feed_mm_s,cutting,measured"


@stage("program.csv")
def csv(toolpath: Toolpath, gate: PathGate, cell: RobotCell | None = None) -> Document | None:
    """Every point of the path, before simplification, as a row of `toolpath.csv`.

    In mm and mm/s, unit quaternions w x y z, in the frame of the path; cutting and measured are 1 or 0. Between layers
    the layer is 0 and the arc length empty. ASCII, CR LF (RFC 4180). Nothing is written where the gate rejects the path
    or a check was loosened.

    Args:
        toolpath: the path.
        gate: of this path's own checks.
        cell: the robot cell, where the pipeline has one: then the path must have postures.

    Raises:
        InputError: the gate is another path's; a cell, but no postures.

    Example:
        >>> from workbench import path, program
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> program.csv(plan, path.check_file(plan)) is None  # a shape only: nothing shows where it lies
        True
    """
    if not released("program.csv", toolpath, gate, cell) or gate.loosened:
        return None
    rows = [HEADER]
    for part in toolpath.in_order:
        rows += _rows(part)
    return Document("toolpath.csv", "\r\n".join([*rows, ""]).encode("ascii"))


def _rows(part: Layer | Travel) -> Iterator[str]:
    pose = zip(
        np.round(part.position_mm, 6).tolist(), part.quaternion_wxyz.tolist(), part.feed_mm_s.tolist(), strict=True
    )
    if isinstance(part, Layer):
        starts = [f"{part.index},{s:.6f}" for s in part.arc_length_mm.tolist()]
        ends = [f"{c:d},{m:d}" for c, m in zip(part.cutting.tolist(), part.measured.tolist(), strict=True)]
    else:
        starts, ends = ["0,"] * len(part.feed_mm_s), ["0,1"] * len(part.feed_mm_s)
    for start, (p, q, feed), end in zip(starts, pose, ends, strict=True):
        yield (f"{start},{p[0]:.6f},{p[1]:.6f},{p[2]:.6f},{q[0]:.9f},{q[1]:.9f},{q[2]:.9f},{q[3]:.9f},{feed:.6f},{end}")
