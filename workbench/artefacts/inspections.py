"""What was measured on a milled edge, against the requirement for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part
from workbench.artefacts.showing import along_chart, rows_table
from workbench.units import Float, Int, Shaped

Verdict = Literal["pass", "fail", "undecided"]


@dataclass(frozen=True, slots=True, eq=False)
class Requirements:
    """What the part must satisfy: nominal values and deviations from them, lower <= 0 <= upper."""

    root_nominal_mm: float = 1.5
    root_tolerance_mm: tuple[float, float] = (-0.5, 0.5)
    bevel_nominal_deg: float = 40.0
    bevel_tolerance_deg: tuple[float, float] = (-1.0, 1.0)


def conformity(value: float, u: float, nominal: float, tolerance: tuple[float, float], guard_factor: float) -> Verdict:
    """Whether a value with standard uncertainty u conforms to nominal + tolerance, all in one unit (ISO 14253-1).

    'pass' inside the limits by at least guard_factor * u, 'fail' outside by at least that, else 'undecided'.
    """
    low, high, guard = nominal + tolerance[0], nominal + tolerance[1], guard_factor * u
    if low + guard <= value <= high - guard:
        return "pass"
    if value <= low - guard or value >= high + guard:
        return "fail"
    return "undecided"


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One inspected section. Values are None where the edge is hidden; `verdict` is then 'undecided'."""

    index: int  # from 1
    arc_length_mm: float
    origin_mm: Shaped[Float, " 3"]  # on the lower edge
    tangent: Shaped[Float, " 3"]  # unit, normal of the section plane
    normal: Shaped[Float, " 3"]  # unit, n
    across: Shaped[Float, " 3"]  # unit, m
    root_mm: float | None
    root_u_mm: float | None
    bevel_deg: float | None
    bevel_u_deg: float | None
    verdict: Verdict
    reason: str
    frames: Int  # indices of the frames that it rests on


@dataclass(frozen=True, slots=True, eq=False)
class EdgeProfile:
    """Root face and bevel angle along the whole edge; NaN where they cannot be measured."""

    arc_length_mm: Shaped[Float, " n"]
    position_mm: Shaped[Float, "n 3"]  # lower edge in the base
    root_mm: Shaped[Float, " n"]
    root_u_mm: Shaped[Float, " n"]
    bevel_deg: Shaped[Float, " n"]
    bevel_u_deg: Shaped[Float, " n"]
    root_u_by_source_mm: Mapping[str, Float] = field(default_factory=dict)  # (n,) each; squares add; empty: not told
    bevel_u_by_source_deg: Mapping[str, Float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class UncertaintySource:
    """One contribution to the combined standard uncertainty (GUM 4.1.4)."""

    name: str
    root_u_mm: float  # to the root face's width, in the section with the largest uncertainty of it
    bevel_u_deg: float  # to the bevel angle, likewise
    kind: Literal["A", "B"]  # evaluated from the scatter of these measurements, or by other means (GUM 4.2, 4.3)


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """The uncertainty budget: the squares of the sources add to the square of the largest section's u."""

    coverage_factor: float = 2.0
    sources: tuple[UncertaintySource, ...] = ()
    not_included: tuple[str, ...] = ()  # sentences
    correlations: str = ""  # why the squares do not add up, where they do not


NO_BUDGET = Uncertainty()


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """The measured part against its requirements (ISO 14253-1 with guard band `guard_factor` * u)."""

    sections: tuple[Section, ...]
    profile: EdgeProfile
    requirements: Requirements
    guard_factor: float
    verdict: Verdict
    reason: str
    root_face_tilt: str  # how the root face's tilt was estimated: 'whole edge' or 'per section'
    part: Part = UNKNOWN_PART
    uncertainty: Uncertainty = NO_BUDGET
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()  # what was checked of recording and faces
    source: str = ""  # the file it was measured in

    def table(self) -> Any:
        """A row a section: a pandas DataFrame where pandas is installed, else a list of dicts."""
        names = ("index", "arc_length_mm", "root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg", "verdict")
        return rows_table([{name: getattr(section, name) for name in names} for section in self.sections])

    def plot(self) -> Any:
        """A matplotlib Figure of root face and bevel angle along the edge, with U = 2 u."""
        p = self.profile
        root, bevel = ("root face, mm", p.root_mm, p.root_u_mm), ("bevel angle, deg", p.bevel_deg, p.bevel_u_deg)
        return along_chart(p.arc_length_mm, root, bevel)
