"""Grooves as they lie on the shop floor, by outside.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from bench.odd_plates import Corners, compound
from bench.outside import FAR_MM, Part, Section, Usual, simulate
from workbench import artefacts
from workbench.units import DEG, Float

AWAY_MM = 1e6  # where what is not at this place of the groove is put
Rng = np.random.Generator
Chain = Callable[[Float], Float]  # corners (n, k, 2) at places w (n,)


@dataclass(frozen=True, slots=True)
class Plate:
    """One plate of a groove, as a left one; its root face stands at 0, its lower surface lies at 0."""

    root_mm: float
    bevel_deg: float
    height_mm: float  # of the bevel
    rise: float = 0.0  # of the upper surface outwards, mm a mm
    above: Corners | None = None  # of another shape than a bevel: from the root face's upper end to the upper surface

    def corners(self) -> Corners:
        """From the lower surface to the upper one."""
        plain = ((-np.tan(self.bevel_deg * DEG) * self.height_mm, self.height_mm),)
        up = tuple((u, self.root_mm + v) for u, v in (self.above if self.above is not None else plain))
        return (
            (-FAR_MM, 0.0),
            (0.0, 0.0),
            (0.0, self.root_mm),
            *up,
            (up[-1][0] - FAR_MM, up[-1][1] + self.rise * FAR_MM),
        )


@dataclass(frozen=True, slots=True)
class Groove(Section):
    """Two plates and what lies between, under and on them; sizes: what is true."""

    left: Plate
    right: Plate
    gap_mm: float
    raised_mm: float  # the right plate's lower surface over the left one's
    fixed: tuple[Corners, ...] = ()  # that is the same all along
    varied: tuple[Chain, ...] = ()
    told: dict[str, float] = field(default_factory=dict)  # what is true, where it is not what a plain groove has

    @property
    def is_prism(self) -> bool:
        return not self.varied

    def segments(self, w: Float) -> Float:
        left = tuple((u - self.gap_mm / 2, v) for u, v in self.left.corners())
        right = tuple((self.gap_mm / 2 - u, self.raised_mm + v) for u, v in self.right.corners())
        table = () if self.table_mm is None else (((2 * FAR_MM, -self.table_mm), (-2 * FAR_MM, -self.table_mm)),)
        still = np.array([[*a, *b] for line in (left, right, *self.fixed, *table) for a, b in pairwise(line)])
        moving = [chain(w) for chain in self.varied]
        return np.concatenate(
            [np.broadcast_to(still, (len(w), len(still), 4))]
            + [np.concatenate([line[:, :-1], line[:, 1:]], axis=-1) for line in moving],
            axis=1,
        )

    def sizes(self) -> dict[str, float]:
        """What is true, by the names of groove.json."""
        upper = [plate.root_mm + plate.height_mm for plate in (self.left, self.right)]
        bevelled = [plate.height_mm for plate in (self.left, self.right) if plate.bevel_deg > 0.0]
        wide = sum(plate.height_mm * np.tan(plate.bevel_deg * DEG) for plate in (self.left, self.right))
        out = {
            "gap_mm": self.gap_mm,
            "root_face_left_mm": self.left.root_mm,
            "root_face_right_mm": self.right.root_mm,
            "bevel_left_deg": self.left.bevel_deg,
            "bevel_right_deg": self.right.bevel_deg,
            "included_deg": self.left.bevel_deg + self.right.bevel_deg,
            "misalignment_mm": self.raised_mm + upper[1] - upper[0],
            "depth_mm": float(np.mean(bevelled)),
        }
        is_plain = self.left.above is None and self.right.above is None
        return out | ({"width_mm": self.gap_mm + wide} if is_plain else {}) | self.told


class Overhead(Usual):
    """A sensor above the groove that shows some of both upper surfaces."""

    def __init__(self, width_mm: float) -> None:
        self.width_mm = width_mm

    def incline_deg(self, rng: Rng, is_raw: bool) -> float:
        return float(rng.uniform(78.0, 102.0))

    def window(self, rng: Rng, thick_mm: float, is_raw: bool) -> tuple[int, float]:
        return int(rng.choice([640, 1024, 1280])), self.width_mm + rng.uniform(12.0, 25.0)


Draw = Callable[[Rng], Groove]


def plain(rng: Rng) -> Groove:
    """A V or Y, alike on both sides or not."""
    root, height = rng.choice([0.0, rng.uniform(0.8, 3.0)], p=[0.2, 0.8]), rng.uniform(4.0, 10.0)
    bevels = np.full(2, rng.uniform(20.0, 45.0)) + rng.choice([0.0, 1.0]) * rng.uniform(-5.0, 5.0, 2)
    roots = np.full(2, root) if rng.random() < 0.5 else root * rng.uniform(0.8, 1.2, 2)
    left, right = (Plate(float(r), float(b), float(root + height - r)) for r, b in zip(roots, bevels, strict=True))
    raised = rng.choice([0.0, rng.uniform(-1.0, 1.0)])
    table = None if rng.random() < 0.5 else rng.uniform(4.0, 30.0)
    gap, thick = rng.choice([0.0, rng.uniform(0.5, 4.0)], p=[0.2, 0.8]), left.root_mm + left.height_mm
    return Groove(thick, 1e-9, 0.0, thick, 0.0, table, left, right, gap, raised)


def _laid(line: Callable[[Rng, Groove], Corners]) -> Draw:
    """A plain groove and a line that is the same all along."""

    def draw(rng: Rng) -> Groove:
        of = plain(rng)
        return replace(of, fixed=(line(rng, of),))

    return draw


def _strip(under_mm: float, reach_mm: float) -> Corners:
    return ((-reach_mm, -under_mm), (reach_mm, -under_mm))


def _backing(rng: Rng, _: Groove) -> Corners:
    """A backing strip under the root, close or some tenths off, wider than the gap."""
    return _strip(rng.choice([0.0, rng.uniform(0.05, 1.0)]), rng.uniform(5.0, 20.0))


def _bead(of: Groove, level_mm: float, crown_mm: float) -> Corners:
    """A weld in the root from flank to flank, crowned or hollow."""
    share = np.linspace(0.0, 1.0, 15)
    reach = [
        of.gap_mm / 2 + np.tan(p.bevel_deg * DEG) * max(level_mm - p.root_mm, 0.0) + 1.0 for p in (of.left, of.right)
    ]
    u = -reach[0] + share * sum(reach)
    return tuple(zip(u.tolist(), (level_mm + crown_mm * 4.0 * share * (1.0 - share)).tolist(), strict=True))


def _drawn_bead(rng: Rng, of: Groove) -> Corners:
    """Of a root run, all along or in tacks."""
    level = max(of.left.root_mm, of.right.root_mm) + rng.uniform(-0.5, 0.45) * of.left.height_mm
    return _bead(of, max(level, 0.1), rng.uniform(-1.0, 1.0) * rng.choice([0.3, 1.5]))


def _tacks(rng: Rng) -> Groove:
    """Tack welds of 3 to 20 mm."""
    of = plain(rng)
    bead = np.array(_drawn_bead(rng, of))
    pitch, length, first = rng.uniform(20.0, 60.0), rng.uniform(3.0, 20.0), rng.uniform(0.0, 30.0)

    def chain(w: Float) -> Float:
        off = np.where(np.mod(w - first, pitch) < length, 0.0, -AWAY_MM)
        return np.stack([np.broadcast_to(bead[:, 0], (w.size, len(bead))), bead[:, 1] + off[:, None]], axis=-1)

    return replace(of, varied=(chain,))


def _spatter(rng: Rng) -> Groove:
    """Drops of 0.3 to 2 mm on upper surfaces and bevels."""
    of = plain(rng)
    drops = []
    for _ in range(int(rng.integers(5, 40))):
        at, radius, place = rng.uniform(0.0, 150.0), rng.uniform(0.15, 1.0), rng.uniform(-1.0, 1.0)
        plate, side = (of.left, -1.0) if place < 0 else (of.right, 1.0)
        raised = 0.0 if side < 0 else of.raised_mm
        along = abs(place) * (plate.height_mm * np.tan(plate.bevel_deg * DEG) + 6.0)
        up = min(along / max(np.tan(plate.bevel_deg * DEG), 1e-3), plate.height_mm)
        centre = (side * (of.gap_mm / 2 + along), raised + plate.root_mm + up)

        def chain(w: Float, at: float = at, radius: float = radius, centre: tuple[float, float] = centre) -> Float:
            r = np.sqrt(np.maximum(radius**2 - (w - at) ** 2, 0.0))[:, None]
            turn = np.linspace(0.0, 2.0 * np.pi, 11 if r.any() else 0)
            off = np.where(r > 0.0, 0.0, -AWAY_MM)
            return np.stack([centre[0] + r * np.cos(turn), centre[1] + off + r * np.sin(turn)], axis=-1)

        drops.append(chain)
    return replace(of, varied=tuple(drops))


def _one_or_both(rng: Rng, of: Groove, change: Callable[[Plate], Plate]) -> Groove:
    """The left plate changed, the right one too half of the time."""
    return replace(of, left=change(of.left), right=of.right if rng.random() < 0.5 else change(of.right))


def _dressed(rng: Rng) -> Groove:
    """Upper edges ground off at 20 to 70 deg, by 0.2 to 2 mm, of one plate or both."""
    of = plain(rng)

    def ground(plate: Plate) -> Plate:
        size, turn = rng.uniform(0.2, 2.0), rng.uniform(0.2, 0.8)
        slope = np.tan(plate.bevel_deg * DEG)
        cut = plate.height_mm - size
        lean = slope + turn * (3.0 - slope)
        above = ((-slope * cut, cut), (-slope * cut - lean * size, plate.height_mm))
        return replace(plate, above=above)

    return _one_or_both(rng, of, ground)


def _compound(rng: Rng) -> Groove:
    """A bevel of two angles, 3 to 30 deg apart, on one plate or both."""
    of = plain(rng)

    def bent(plate: Plate) -> Plate:
        other = float(np.clip(plate.bevel_deg + rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 30.0), 2.0, 65.0))
        return replace(plate, above=compound(plate.bevel_deg, other, rng.uniform(0.15, 0.85), plate.height_mm))

    return _one_or_both(rng, of, bent)


def _rounded(rng: Rng) -> Groove:
    """Upper edges rounded by 0.2 to 2 mm."""
    of, radius = plain(rng), rng.uniform(0.2, 2.0)

    def round_(plate: Plate) -> Plate:
        bevel, top = plate.bevel_deg * DEG, plate.height_mm
        centre = (-np.tan(bevel) * top - radius * np.tan(0.5 * (np.pi / 2 - bevel)), top - radius)
        turn = np.linspace(bevel, np.pi / 2, 13)  # of the outward normal over the horizontal
        arc = tuple((centre[0] + radius * np.cos(t), centre[1] + radius * np.sin(t)) for t in turn)
        return replace(plate, above=arc)

    return replace(of, left=round_(of.left), right=round_(of.right))


def _two_thicknesses(rng: Rng) -> Groove:
    """Plates of different thickness, level below."""
    of = plain(rng)
    right = replace(of.right, height_mm=of.right.height_mm + rng.uniform(-3.0, 3.0))
    return replace(of, right=right, raised_mm=0.0)


def _single(rng: Rng) -> Groove:
    """One plate square, the other bevelled: HV or HY."""
    of = plain(rng)
    right = Plate(of.left.root_mm + of.left.height_mm - 1e-6, 0.0, 1e-6)
    return replace(of, right=right, gap_mm=max(of.gap_mm, 0.5))


def _upper_edge(of: Groove) -> float:
    """Where the left plate's bevel meets its upper surface."""
    return -of.gap_mm / 2 - of.left.height_mm * np.tan(of.left.bevel_deg * DEG)


def _on_surface(rng: Rng, of: Groove) -> Corners:
    """Tape, a scribed line or an old bead along an upper surface, 1 to 6 mm from the edge."""
    upper, height, wide = of.left.root_mm + of.left.height_mm, rng.choice([-0.3, 0.1, 0.3, 1.0]), rng.uniform(0.5, 6.0)
    edge = _upper_edge(of) - rng.uniform(1.0, 6.0)
    return ((edge, upper - 1.0), (edge, upper + height), (edge - wide, upper + height), (edge - wide, upper - 1.0))


def _below(rng: Rng, _: Groove) -> Corners:
    """A strip that hangs some millimetres below the plates: a backing that does not touch."""
    return _strip(rng.uniform(1.0, 6.0), rng.uniform(3.0, 20.0))


def _ceramic(rng: Rng, of: Groove) -> Corners:
    """A ceramic backing with a round channel under the root, as wide as the gap or wider."""
    deep, share = rng.uniform(0.5, 2.0), np.linspace(-1.0, 1.0, 15)
    wide = of.gap_mm / 2 + rng.uniform(0.5, 5.0)
    arc = tuple(zip((wide * share).tolist(), (deep * (share**2 - 1.0)).tolist(), strict=True))
    return ((-20.0, 0.0), *arc, (20.0, 0.0))


def _part_filled(rng: Rng, of: Groove) -> Corners:
    """Layers of weld up to a third and more of the depth; the next one not begun."""
    level = of.left.root_mm + rng.uniform(0.3, 0.95) * of.left.height_mm
    return _bead(of, level, rng.uniform(-0.6, 0.6))


def _thin_run(rng: Rng) -> Groove:
    """A thin weld, of 0.05 to 0.6 mm, between roots that touch or nearly."""
    of = plain(rng)
    of = replace(of, gap_mm=rng.choice([0.0, 0.2]))
    level = max(of.left.root_mm, of.right.root_mm + of.raised_mm) + rng.uniform(0.05, 0.6)
    return replace(of, fixed=(_bead(of, level, 0.0),))


def _primer(rng: Rng, of: Groove) -> Corners:
    """Primer of 0.03 to 0.15 mm on one plate, masked beside the edge; or rolling scale that has come off there."""
    height, upper = rng.uniform(0.03, 0.15), of.left.root_mm + of.left.height_mm
    edge = _upper_edge(of) - rng.uniform(0.5, 8.0)
    return ((edge, upper - 1.0), (edge, upper + height), (edge - FAR_MM, upper + height))


def _bent(rng: Rng) -> Groove:
    """Plates that do not stand level with each other, by 0.3 to 3 deg, up or down: shrinkage of a tack, a roof."""
    of, turn = plain(rng), rng.uniform(0.3, 3.0) * rng.choice([-1.0, 1.0]) * DEG
    left, slope = of.left, np.tan(of.left.bevel_deg * DEG)
    corner = np.array([-slope * left.height_mm, left.height_mm])
    spin = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    upper = spin @ corner
    bent = replace(left, rise=float(np.tan(turn)), above=((upper[0], upper[1]),))
    right = of.right
    reach = np.array([np.tan(right.bevel_deg * DEG) * right.height_mm, right.height_mm])
    root = np.array([max(of.gap_mm, 1.0), of.raised_mm + right.root_mm - left.root_mm])  # from the left one
    axes = np.array([[np.cos(turn / 2), -np.sin(turn / 2)], [np.sin(turn / 2), np.cos(turn / 2)]])
    gap, (width, step) = axes[0] @ root, axes @ (root + reach - upper)
    bevels = left.bevel_deg + right.bevel_deg
    told = {"gap_mm": gap, "width_mm": width, "misalignment_mm": step, "included_deg": bevels - turn / DEG}
    return replace(of, left=bent, gap_mm=float(root[0]), told=told)


SHAPES: dict[str, Draw] = {
    "plain": plain,
    "one plate square": _single,
    "backing strip": _laid(_backing),
    "tack welds": _tacks,
    "root run": _laid(_drawn_bead),
    "spatter": _spatter,
    "upper edges ground": _dressed,
    "upper edges rounded": _rounded,
    "two bevel angles a side": _compound,
    "plates of two thicknesses": _two_thicknesses,
    "tape or bead on a plate": _laid(_on_surface),
    "strip below the plates": _laid(_below),
    "ceramic backing": _laid(_ceramic),
    "groove filled in part": _laid(_part_filled),
    "thin weld in a closed root": _thin_run,
    "primer masked at the edge": _laid(_primer),
    "plates that are not level": _bent,
}


def odd_groove(shape: str, seed: int) -> Part:
    """Part `seed` of one of SHAPES; its `section` is a Groove."""
    rng = np.random.default_rng([784, seed, list(SHAPES).index(shape)])
    groove = SHAPES[shape](rng)
    wide = groove.gap_mm + 2.0 * max(abs(plate.corners()[-2][0]) for plate in (groove.left, groove.right))
    return simulate(seed, True, groove, Overhead(wide))


def exact(part: Part, kind: str, section: artefacts.Section) -> dict[str, float]:
    """True sizes by the names of groove.json, of a section of a groove that was found to be of a type."""
    assert isinstance(part.section, Groove)
    sizes = part.section.sizes()
    if kind in ("HV", "HY", "J", "K"):  # the depth is of the plate seen
        heights, told = (part.section.left.height_mm, part.section.right.height_mm), section.values.get("depth_mm")
        sizes["depth_mm"] = min(heights, key=lambda height: abs(height - (told or 0.0)))
    return swapped(sizes) if float(part.base_from_section[:3, 0] @ section.normal) < 0 else sizes


def swapped(sizes: Mapping[str, float]) -> dict[str, float]:
    """Sizes of a groove from its other end: left is right, and what is raised is lower."""
    other = {"left": "right", "right": "left"}
    turned = {"_".join(other.get(word, word) for word in name.split("_")): value for name, value in sizes.items()}
    return turned | ({"misalignment_mm": -turned["misalignment_mm"]} if "misalignment_mm" in turned else {})
