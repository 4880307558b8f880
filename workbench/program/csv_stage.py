"""`program.csv`: the points of the path as a table."""

from __future__ import annotations

import io

import numpy as np

from workbench.artefacts import Document, Layer, PathGate, RobotCell, Toolpath
from workbench.dialect import released
from workbench.stage import stage
from workbench.units import AnyArray

POINT = "%.6f,%.6f,%.6f,%.9f,%.9f,%.9f,%.9f,%.6f"  # place, quaternion, feed
HEADER = "layer,arc_length_mm,x_mm,y_mm,z_mm,qw,qx,qy,qz,feed_mm_s,cutting,measured"


@stage("program.csv")
def csv(toolpath: Toolpath, gate: PathGate, cell: RobotCell | None = None) -> Document | None:
    """Every point of the path, before simplification, as a row of `toolpath.csv`.

    In mm and mm/s, unit quaternions w x y z, in the frame of the path; cutting and measured are 1 or 0. Between layers
    the layer is 0 and the arc length empty. Nothing is written where the gate rejects the path or a check was loosened;
    a path that is a shape only is written, and the exit status stays 1.

    Args:
        toolpath: the path.
        gate: of this path's own checks.
        cell: the robot cell, where the pipeline has one: then the path must have postures.

    Raises:
        InputError: the gate is another path's; a cell, but no postures.

    Example:
        >>> from workbench import path, program
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> program.csv(plan, path.check_file(plan)).name
        'toolpath.csv'
    """
    if not (released("program.csv", toolpath, gate, cell) and gate.only_place_open):
        return None
    out = io.StringIO(HEADER + "\r\n")
    out.seek(0, io.SEEK_END)
    for part in toolpath.in_order:
        begin, end = "0,,", ",0,1"
        columns: list[AnyArray] = [part.position_mm, part.quaternion_wxyz, part.feed_mm_s]
        if isinstance(part, Layer):
            begin, end = f"{part.index},%.6f,", ",%d,%d"
            columns = [part.arc_length_mm, *columns, part.cutting, part.measured]
        np.savetxt(out, np.column_stack(columns), f"{begin}{POINT}{end}", newline="\r\n")
    return Document("toolpath.csv", out.getvalue().encode("ascii"))
