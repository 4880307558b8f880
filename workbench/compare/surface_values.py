"""Surfaces, registrations and deviations: what the comparison of shapes exchanges."""

from __future__ import annotations

from dataclasses import dataclass

from workbench.artefacts import UNKNOWN_PART, Check, Part
from workbench.units import Bool, Float, Int, Shaped


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Something to compare: points of a scan, or a mesh of triangles between its points. mm, in the base."""

    points_mm: Shaped[Float, "n 3"]
    triangles: Shaped[Int, "k 3"] | None = None  # counter-clockwise from outside; None: points of a scan
    frame: Shaped[Int, " n"] | None = None  # in which each point was measured; None: not known
    range_axis: Shaped[Float, " 3"] | None = None  # mean direction of the profiler's z, of either sense; None: unknown
    course_mm: Shaped[Float, "m 3"] | None = None  # along which arc length counts; None: none is known
    source: str = ""
    part: Part = UNKNOWN_PART
    checks: tuple[Check, ...] = ()  # of the recording that it was made from
    passes_apart_mm: float | None = 0.0  # of several passes, how far from one place they see a face; None: not known


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Where a scan lies against a reference.

    The covariance is that of a small motion about `pivot_mm`: x_true = x + dt + w x (x - pivot), in the reference's
    frame (the base). In directions that the shapes leave open the scan was held at its initial pose.
    """

    reference_from_scan: Shaped[Float, "4 4"]
    covariance: Shaped[Float, "6 6"]  # dt in mm, w in rad
    pivot_mm: Shaped[Float, " 3"]
    overlap: float  # share of the scan's points that lie on the reference
    rms_mm: float  # of their distances along the normal
    held: tuple[str, ...]  # directions that the shapes leave open, in words
    points: int  # that it rests on
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Deviations:
    """Signed distances of a scan from a reference at c places, positive outside; NaN where either is missing."""

    position_mm: Shaped[Float, "c 3"]  # on the scan, registered
    normal: Shaped[Float, "c 3"]  # unit, outwards
    distance_mm: Shaped[Float, " c"]
    u_mm: Shaped[Float, " c"]  # standard uncertainty, that of the place included
    detectable_mm: Shaped[Float, " c"]  # level of detection at 95 %: below, no change is significant
    arc_length_mm: Shaped[Float, " c"]  # along the course
    across_mm: Shaped[Float, " c"]  # from the course, over the surface: for the map
    sources: tuple[tuple[str, float], ...] = ()  # of u, each with its median in mm
    warnings: tuple[str, ...] = ()

    @property
    def significant(self) -> Bool:
        """(c,) whether the distance exceeds its level of detection."""
        return abs(self.distance_mm) > self.detectable_mm
