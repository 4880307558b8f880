"""An inspection beside the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .stranger import Part, Setting


@dataclass(frozen=True)
class Errors:
    """One value a section; NaN where it was not measured."""

    along_mm: np.ndarray  # true arc length of the section's origin
    off_mm: np.ndarray  # distance of the origin from the true lower edge
    aside_deg: np.ndarray  # of the tangent
    root_mm: np.ndarray
    bevel_deg: np.ndarray
    told_mm: np.ndarray  # arc length as reported


def errors(inspection: dict[str, Any], part: Part, setting: Setting) -> Errors:
    """What the file says of each section, minus what is true there."""
    part_from_base = np.linalg.inv(setting.base_from_part)
    column = {key: np.array([one[key] for one in inspection["sections"]], float) for key in _KEYS}
    origin = column["origin_mm"] @ part_from_base[:3, :3].T + part_from_base[:3, 3]
    tangent = column["tangent"] @ part_from_base[:3, :3].T
    s = part.nearest(origin)
    cosine = np.sum(tangent * part.tangent(s), axis=1)
    return Errors(
        s,
        np.linalg.norm(origin - part.lower_edge(s), axis=1),
        np.degrees(np.arccos(np.clip(cosine, -1, 1))),
        column["root_mm"] - part.root(s),
        column["bevel_deg"] - part.bevel(s),
        column["arc_length_mm"],
    )


_KEYS = ("origin_mm", "tangent", "root_mm", "bevel_deg", "arc_length_mm")
