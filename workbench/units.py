"""Unit conversions. Inside Python: mm, s, N, Nm, rad; degrees only in names that end in `_deg`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]
AnyArray = NDArray[Any]

DEG = math.pi / 180.0  # rad per degree: `angle_deg * DEG` is in rad, `angle / DEG` in deg


def frozen(array: AnyArray) -> AnyArray:
    """`array`, made read-only (a view; the caller gives up writing to it)."""
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view
