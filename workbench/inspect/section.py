"""One section of an edge, a preparation or a groove: where it lies, what was measured there, and its verdict."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from workbench.artefacts import MilledEdge, Quantity, Section
from workbench.artefacts.edges import Joint
from workbench.inspect.verdict import judged
from workbench.units import Float

HIDDEN = "the edge is hidden here"
NEAR_MM = 10.0  # frames this near to a section are drawn with it


def section_at(
    index: int,
    at_mm: float,
    edge: MilledEdge | Joint,
    origin_mm: Float,
    sizes: Iterable[Quantity],
    required: Mapping[str, tuple[float, tuple[float, float]]],
    terms: Mapping[str, tuple[str, str]],
    guard_factor: float,
) -> Section:
    """The section at an arc length, of sizes (n,) and origins (n, 3) at the stations.

    Place and axes are interpolated over hidden stations, sizes are not.
    """
    good = np.isfinite(origin_mm[:, 0])

    def here(values: Float) -> Float:
        return np.array([np.interp(at_mm, edge.arc_length_mm[good], column) for column in values[good].T])

    there = {one.name: one.at(at_mm, edge.arc_length_mm) for one in sizes}
    seen = any(np.isfinite(one.value) for one in there.values())
    near = np.abs(edge.frame_arc_length_mm - at_mm) <= NEAR_MM
    tangent, normal, across = (here(axis) for axis in (edge.tangent, edge.normal, edge.across))
    verdict, reason = judged(there, required, terms, guard_factor) if seen else ("undecided", HIDDEN)
    return Section(
        index,
        at_mm,
        here(origin_mm),
        tangent / np.linalg.norm(tangent),
        normal / np.linalg.norm(normal),
        across / np.linalg.norm(across),
        there,
        verdict,
        reason,
        np.flatnonzero(near & seen),
    )
