"""A measured size with its uncertainty by source: the only place where squares of uncertainties add."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from workbench.units import AnyArray, Float

Kind = Literal["A", "B"]

# Sources of uncertainty of root face and bevel angle.
END = "end of the root face and range noise"
DIRECTIONS = "directions of the faces"
TANGENT = "direction of the edge: robot position noise and hand-eye pose"
FORM = "form of the faces: what straight lines leave"
ROUNDING = "rounding of the lower edge"
STEPS = "steps and waves along the edge"
HIDDEN = "part of the end that no column shows"
PASSES = "agreement of scanning passes"
DECLARED = "declared for what no frame shows"
SCATTER = (END, DIRECTIONS, FORM, PASSES, STEPS, "faces", "fixed pattern", "corners")  # begin the names of type A


def kind_of(source: str) -> Kind:
    """How a source of an engine that does not state it is evaluated (GUM 4.2, 4.3)."""
    return "A" if source.startswith(SCATTER) else "B"


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One contribution to the uncertainty of a quantity (GUM 4.1.4), independent of its other terms."""

    source: str  # in words, as the budget names it
    kind: Kind  # evaluated from the scatter of these measurements, or by other means (GUM 4.2, 4.3)
    u: AnyArray | float  # standard uncertainty in the unit of the quantity: one, or one a station (n,)
    length_mm: float | None = None  # over which its error stays alike along the edge; inf: all of it; None: not known


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A measured size: one value, or one a station along the edge; NaN where it was not measured.

    The name ends in the unit, as everywhere: `root_mm` is in mm, `bevel_deg` in degrees.

    >>> noise, scale = Term("noise", "A", np.array([0.03, 0.04])), Term("scale", "B", 0.03)
    >>> root = Quantity("root_mm", np.array([1.5, 1.6]), (noise, scale))
    >>> root.unit, root.u.round(3).tolist()
    ('mm', [0.042, 0.05])
    >>> middle = root.at(0.5, np.array([0.0, 1.0]))
    >>> float(middle.value), [float(term.u) for term in middle.terms]
    (1.55, [0.035, 0.03])
    """

    name: str  # such as root_mm, bevel_deg, gap_mm
    value: Float  # () or (n,)
    terms: tuple[Term, ...] = ()

    @classmethod
    def of(cls, name: str, value: AnyArray | float, u_by_source: Mapping[str, AnyArray | float]) -> Quantity:
        """A quantity whose sources are known by name alone."""
        return cls(
            name, np.asarray(value), tuple(Term(source, kind_of(source), u) for source, u in u_by_source.items())
        )

    @classmethod
    def joined(cls, name: str, places: Sequence[Quantity | None]) -> Quantity:
        """Quantities at single places as one over all of them (n,); None: NaN there."""
        known = [None if one is None or not np.isfinite(one.value) else one for one in places]
        kinds = {term.source: term.kind for one in known if one is not None for term in one.terms}
        u = {source: np.full(len(places), np.nan) for source in kinds}
        value = np.full(len(places), np.nan)
        for k, one in enumerate(known):
            if one is not None:
                value[k], by_source = one.value, one.u_by_source
                for source, column in u.items():
                    column[k] = by_source.get(source, 0.0)
        return cls(name, value, tuple(Term(source, kinds[source], column) for source, column in u.items()))

    @property
    def unit(self) -> str:
        """Of the value, of `u` and of every term."""
        return self.name.rpartition("_")[2]

    @property
    def u(self) -> Float:
        """Combined standard uncertainty: () or (n,)."""
        return root_sum_square(self.value, (term.u for term in self.terms))

    @property
    def u_by_source(self) -> dict[str, Float]:
        """What each source contributes, () or (n,) each; terms of one source are one entry."""
        names = dict.fromkeys(term.source for term in self.terms)
        return {
            name: root_sum_square(self.value, (term.u for term in self.terms if term.source == name)) for name in names
        }

    def at(self, place_mm: AnyArray | float, arc_length_mm: Float) -> Quantity:
        """The quantity at arc lengths () or (m,), interpolated between the stations `arc_length_mm` (n,).

        Value and terms are interpolated each by itself, since errors of neighbouring stations are alike.
        """

        def here(values: AnyArray | float) -> AnyArray | float:
            return values if np.ndim(values) == 0 else np.asarray(np.interp(place_mm, arc_length_mm, values))

        return Quantity(
            self.name, np.asarray(here(self.value)), tuple(replace(term, u=here(term.u)) for term in self.terms)
        )

    def where(self, known: AnyArray) -> Quantity:
        """The same quantity with NaN, in value and terms, at the stations (n,) that are not `known`."""
        terms = tuple(replace(term, u=np.where(known, term.u, np.nan)) for term in self.terms)
        return Quantity(self.name, np.where(known, self.value, np.nan), terms)


def root_sum_square(like: AnyArray | float, u: Iterable[AnyArray | float]) -> Float:
    """The root of the sum of the squares of independent contributions, as many as `like` has values."""
    total = np.zeros(np.shape(like))
    for one in u:
        total = total + np.square(one)
    return np.asarray(np.sqrt(total))
