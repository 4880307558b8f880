"""Parts of the third simulator: `bench.outside`."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from bench.drawn.seeds import generator, nominal
from bench.faulty import CHATTER, KINDS
from bench.odd_plates import DEBURRED, odd_plate
from bench.outside import Part, Section, Usual, simulate
from bench.score.errors import about_robot, as_real
from bench.score.parts import Drawn
from workbench.scan.fuse_stage import flange_poses
from workbench.units import DEG

SHAPES = (
    DEBURRED,
    "compound bevel",
    "ledge of 0.05 to 0.5 mm",
    "a bevel below as well",
    "a rail in front",
    "on a table, or up to 3 mm above",
    "lower edge rounded by 0.15 to 1.2 mm",
    "lower part of the root face stands back",
    "on a table, lower edge rounded",
)
FAULTS = tuple(KINDS)


class Sharp(Usual):
    """Sharp edges, seen at 35 to 55 deg."""

    incline = (35.0, 55.0)
    radius_mm: tuple[float, float] | None = None
    on_table = True

    def incline_deg(self, rng: np.random.Generator, is_raw: bool) -> float:
        return float(rng.uniform(*self.incline))

    def section(self, rng: np.random.Generator, is_raw: bool) -> Section:
        usual = super().section(rng, is_raw)
        radius = float(rng.uniform(*self.radius_mm)) if self.radius_mm else 0.0
        return dataclasses.replace(usual, radius_mm=radius, table_mm=usual.table_mm if self.on_table else None)


class Worn(Sharp):
    """Rounded by 0.01 to 0.3 mm, seen at 20 to 50 deg."""

    incline = (20.0, 50.0)
    radius_mm = (0.01, 0.3)


class Below(Worn):
    """The same, seen from below the root face's normal, or squarely; nothing lies under the plate, to hide it."""

    incline = (-20.0, 5.0)
    on_table = False


def stations(part: Part) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along the edge (n,), their points in the base (n, 3), and whether frames see them."""
    place = flange_poses(part.recording) @ part.recording.flange_from_profiler
    x, z = (np.nan_to_num(np.nanmedian(g.astype(float), axis=1)) for g in (part.recording.x_mm, part.recording.z_mm))
    middle = np.einsum("nij,nj->ni", place, np.stack([x, 0 * x, z, 1 + 0 * x], axis=1))
    w = (np.linalg.inv(part.base_from_section) @ middle.T)[2]
    along = np.linspace(w.min() - 5.0, w.max() + 5.0, 301)
    zero = np.zeros_like(along)
    points = (part.base_from_section @ np.stack([zero, zero, along, zero + 1.0])).T[:, :3]
    return along, points, (along >= w.min() + 2.0) & (along <= w.max() - 2.0)


def milled_part(part: Part, known: dict[str, Any], about: str) -> Drawn:
    along, points, seen = stations(part)
    true = {"root_mm": part.section.root_at(along), "bevel_deg": np.full_like(along, part.section.bevel / DEG)}
    declared = nominal(part.section.root_mm, part.section.bevel / DEG) | known
    return Drawn(part.recording, {"position_mm": points, "seen": seen} | true, declared, about)


def sharp(seed: int) -> Drawn:
    return milled_part(simulate(seed, False, cell=Sharp()), {}, "plain")


def worn(seed: int) -> Drawn:
    return _worn(simulate(seed, False, cell=Worn()), generator("score outside worn", seed), {})


def below(seed: int) -> Drawn:
    part = simulate(seed, False, cell=Below())
    upper_side = {"upper_side": part.base_from_section[:3, 1].tolist()}
    return _worn(part, generator("score outside below", seed), upper_side)


def _worn(part: Part, rng: np.random.Generator, declared: dict[str, Any]) -> Drawn:
    recording, known = as_real(part.recording, rng, 0.005, 0.03)
    about = f"radius {part.section.radius_mm:.3f} mm, {about_robot(known)}"
    return milled_part(part._replace(recording=recording), known | declared, about)


def odd(seed: int) -> Drawn:
    """Every kind in turn."""
    number = seed % (len(SHAPES) + len(FAULTS))
    if number < len(SHAPES):
        return milled_part(odd_plate(SHAPES[number], seed, False), {}, SHAPES[number])
    fault = FAULTS[number - len(SHAPES)]
    part = KINDS[fault](seed, False, generator("score outside odd", seed))
    if fault == CHATTER:  # the root face that a section of some millimetres has
        part = part._replace(section=Section(*(getattr(part.section, f.name) for f in dataclasses.fields(Section))))
    return milled_part(part, {}, fault)


def raw_part(part: Part, known: dict[str, Any], about: str) -> Drawn:
    """A raw edge, of which a user knows the upper side and what is `known` besides."""
    _, points, seen = stations(part)
    n, m, t = (np.broadcast_to(part.base_from_section[:3, k], points.shape) for k in range(3))
    true = {"position_mm": points, "normal": n, "across": m, "tangent": t, "seen": seen}
    return Drawn(part.recording, true, {"kind": "raw", "upper_side": m[0].tolist()} | known, about)


def plain(part: Part, is_raw: bool) -> Drawn:
    """A part of which nothing else is known."""
    return (raw_part if is_raw else milled_part)(part, {}, "")


def raw(seed: int) -> Drawn:
    rng = generator("score outside raw", seed)
    part = simulate(seed, True)
    recording, known = as_real(part.recording, rng, 0.01, 0.06)
    about = f"raw, radius {part.section.radius_mm:.3f} mm, {about_robot(known)}"
    return raw_part(part, known, about)._replace(recording=recording)


DRAWS = {"sharp": sharp, "worn": worn, "below": below, "odd": odd, "raw": raw}
