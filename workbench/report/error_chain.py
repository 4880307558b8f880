"""What each link between the sensor and the cutter costs in root face and bevel angle, blind and with a measured cut.

A link that displaces the cutter against the edge by e moves the bevel face by b . e along its normal b, and the root
size by b . e / sin(bevel); one that turns it about the feed turns the bevel by as much. Links are independent: squares
add (JCGM 100, 5.1.2). A measured first cut takes out what both cuts share (`path.correct`): of a link remains `left`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

STEEL_PER_K = 11.5e-6  # thermal expansion
UNIFORM = math.sqrt(3.0)  # half a range over its standard deviation


@dataclass(frozen=True, slots=True)
class Link:
    """One link of the chain, as standard uncertainties."""

    name: str
    source: str  # where its numbers come from, in words
    along_b_mm: float  # of the face's place, along its normal
    tilt_deg: float  # of its direction, about the feed
    left: float  # share that remains after a correction by a measured cut
    why_left: str


@dataclass(frozen=True, slots=True)
class Need:
    """One characteristic: its tolerance, and how the chain serves it."""

    name: str
    unit: str
    half_width: float  # of the tolerance, the narrower side
    u: tuple[float, ...]  # of each link, in the order of the chain

    @property
    def total(self) -> float:
        """Combined standard uncertainty."""
        return math.sqrt(sum(u * u for u in self.u))

    @property
    def holds(self) -> bool:
        """Whether U = 2 u fits into the tolerance: about 95 % of the places, and no room for anything else."""
        return 2.0 * self.total <= self.half_width

    @property
    def worst(self) -> int:
        """The link that costs most."""
        return max(range(len(self.u)), key=lambda k: self.u[k])

    def share(self, link: int) -> float:
        """Of the variance."""
        return self.u[link] ** 2 / max(self.total**2, 1e-300)

    def without(self, link: int) -> float:
        """Combined standard uncertainty if this link were perfect."""
        return math.sqrt(max(self.total**2 - self.u[link] ** 2, 0.0))

    def allowed(self, link: int) -> float | None:
        """Greatest u of a link, all others as they are, with which U = 2 u fits; None: not by this link alone."""
        left = (self.half_width / 2.0) ** 2 - self.without(link) ** 2
        return math.sqrt(left) if left > 0.0 else None


def needs(
    links: Sequence[Link], measured: bool, bevel: float, root_half_mm: float, bevel_half_deg: float
) -> tuple[Need, Need]:
    """Root face and bevel angle (`bevel` in rad): milled blindly, or corrected by a measured cut."""
    share = [link.left if measured else 1.0 for link in links]
    root = tuple(link.along_b_mm * s / math.sin(bevel) for link, s in zip(links, share, strict=True))
    tilt = tuple(link.tilt_deg * s for link, s in zip(links, share, strict=True))
    return Need("root face", "mm", root_half_mm, root), Need("bevel angle", "deg", bevel_half_deg, tilt)


def thermal_mm(kelvin: float, length_mm: float) -> float:
    """Standard uncertainty of a length of steel over ± `kelvin` of any temperature (uniform)."""
    return STEEL_PER_K * kelvin * length_mm / UNIFORM
