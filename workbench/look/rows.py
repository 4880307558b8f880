"""A groove in rows of ranges alone: what `edge.segment_groove` says of it, in columns and counts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud, Groove
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.errors import InputError
from workbench.units import Float

# Neither a column's nor a count's nor a row's size is known: they are taken as so much, since the engine's limits are
# those of sensors. Rows so far apart leave a groove that wanders from row to row square to them.
COUNT_MM, ROW_MM = 0.05, 5.0


class Rows(NamedTuple):
    """Courses of a groove's corners through N rows, by the corner's name; NaN where they are not told."""

    groove: Groove
    column: dict[str, Float]  # (N,)
    column_u: dict[str, Float]  # (N,) standard uncertainty
    z: dict[str, Float]  # (N,) counts

    @property
    def summary(self) -> str:
        """Type, rows that were read, corners in the median, sizes with U = 2 u in columns, what is not told."""
        like = ", ".join(self.groove.alternatives)
        seen = np.isfinite(self.groove.frame_arc_length_mm)
        corners = (f"{name} {np.nanmedian(at):.1f}" for name, at in self.column.items() if np.isfinite(at).any())
        sizes = (
            f"{name.removesuffix('_mm')} {np.nanmedian(size.value) / COUNT_MM:.1f} ± "
            f"{2.0 * np.nanmedian(size.u) / COUNT_MM:.1f}"
            for name, size in self.groove.sizes.items()
            if name in ("width_mm", "gap_mm") and np.isfinite(size.value).any()
        )
        without = [name for name, at in self.column.items() if not np.isfinite(at).any()]
        return "; ".join(
            [
                f"groove: {self.groove.type}"
                + (f" (or {like})" if like else "")
                + f" by {seen.sum()} of {seen.size} rows",
                f"corners in the median at columns {', '.join(corners)}",
                f"in columns {', '.join(sizes)}",
                *([f"no return shows where {' and '.join(without)} are"] if without else []),
                *self.groove.warnings[len(self.groove.alternatives) > 0 :],
            ]
        )


def groove_of_rows(z: Float, source: str) -> Rows | None:
    """The groove across rows of ranges (N, M), NaN: no return, either sense; None: the engine finds none.

    Args:
        z: counts of an unknown unit.
        source: the file, for messages.
    """
    pose = np.tile(np.eye(4), (len(z), 1, 1))
    pose[:, 1, 3] = way = np.arange(0.0, ROW_MM * len(z), ROW_MM)
    x = np.tile(COUNT_MM * np.arange(z.shape[1], dtype=np.float32), (len(z), 1))
    ranges, one_pass = (COUNT_MM * z).astype(np.float32), np.zeros(len(z), np.int64)
    cloud = Cloud(x, ranges, np.isfinite(z), pose, way, one_pass, source=source)
    try:
        groove = segment_groove(denoise(cloud))
    except InputError:
        return None
    rows = Rows(groove, {}, {}, {})
    for name, corner in groove.corners.items():
        right, up = corner.section_mm.T[:, :, None]
        place = groove.origin_mm + right * groove.normal + up * groove.across
        if name.endswith("root"):  # of a face that ends alone, reflections may hide the rest
            place = np.where(np.isfinite(groove.sizes["gap_mm"].value)[:, None], place, np.nan)
        known = np.isfinite(place[:, 0])
        along, nothing = np.where(known, place[:, 1], groove.origin_mm[:, 1]), np.where(known, 0.0, np.nan)
        order = np.argsort(along)  # the engine's way along the groove may be against the rows'
        shown = (way > along.min() - ROW_MM) & (way < along.max() + ROW_MM)
        values = place[:, 0], corner.u_mm[:, 0], place[:, 2]
        for of, value in zip((rows.column, rows.column_u, rows.z), values, strict=True):
            course = np.interp(way, along[order], (value + nothing)[order])
            of[name] = np.where(shown, course, np.nan) / COUNT_MM
    return rows
