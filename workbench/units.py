"""Unit conversions. Inside Python: mm, s, N, Nm, rad; degrees only in names that end in `_deg`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from jaxtyping import Shaped as Shaped
else:  # Shaped[Float, "n 3"]: an array by its axes; the tests take jaxtyping's here and check it (tests/shapes.py)
    Shaped = Annotated

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]
AnyArray = NDArray[Any]

DEG = math.pi / 180.0  # rad per degree: `angle_deg * DEG` is in rad, `angle / DEG` in deg
MM = 1e3  # mm per m
COVERAGE = 2.0  # U = k u with k = 2, about 95 %
MEDIAN_U = 1.2533  # standard uncertainty of a median over that of a mean, of a normal distribution
THIRD = math.sqrt(20.0)  # standard deviation of third differences, of noise of 1
TO_SD = 1.4826  # a normal distribution's standard deviation by its median absolute value


def frozen(array: AnyArray) -> AnyArray:
    """`array`, made read-only (a view; the caller gives up writing to it)."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view
