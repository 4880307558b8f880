"""What belongs to a drawn part: the random numbers of its seed, and what a drawing says of it."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np


def generator(*words: str | int) -> np.random.Generator:
    """Random numbers that belong to these words."""
    return np.random.default_rng([zlib.crc32(w.encode()) if isinstance(w, str) else w for w in words])


def nominal(root_mm: float, bevel_deg: float) -> dict[str, Any]:
    """What a drawing says: rounded to 0.5 mm and 5 deg."""
    return {"kind": "milled"} | nominal_sizes(root_mm, bevel_deg)


def nominal_sizes(root_mm: float, bevel_deg: float) -> dict[str, float]:
    """The sizes alone, by the parameters' names."""
    root, bevel = max(0.5, round(2.0 * float(root_mm)) / 2.0), 5.0 * round(float(bevel_deg) / 5.0)
    return {"root_nominal_mm": root, "bevel_nominal_deg": bevel}
