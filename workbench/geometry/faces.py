"""One face of the edge as straight lines, one a frame: the sums that least squares needs."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.units import Float, Int, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class FaceLines:
    """One face as straight lines z(x), one a frame, in the profiler frame.

    `count` is 0 where the face is not seen in the frame; all other entries are then NaN.
    """

    count: Shaped[Int, " N"]  # points used
    x_mean: Shaped[Float, " N"]  # mm
    z_mean: Shaped[Float, " N"]  # mm
    sxx: Shaped[Float, " N"]  # sum (x - x_mean)^2, mm^2
    sxz: Shaped[Float, " N"]  # sum (x - x_mean)(z - z_mean), mm^2
    szz: Shaped[Float, " N"]  # sum (z - z_mean)^2, mm^2
    columns: Shaped[Int, "N 2"]  # first and last column of the face; -1 where not seen
