"""The broken lower end of a face: laws of `edge.segment` over parts whose edge radius is known (bench.outside)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.outside import Part, Usual, drawn_section, simulate
from bench.score.measure import one
from bench.score.outsider import below as outside_below
from bench.score.parts import Drawn
from bench.score.triangulated import below as triangulated_below
from bench.score.triangulated import sensor, way, workpiece
from bench.simulators.triangulated import simulate as triangulated
from tests.seldom import seldom
from workbench.artefacts import MilledEdge
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.scan import fuse
from workbench.units import DEG, Float


class Seen(Usual):
    """A usual cell whose rays stand at a given angle to the root face's normal."""

    def __init__(self, incline_deg: float) -> None:
        self.at_deg = incline_deg

    def incline_deg(self, rng: np.random.Generator, is_raw: bool) -> float:
        return self.at_deg


def rounded(seed: int, radius_mm: float, incline_deg: float) -> Part:
    section = replace(drawn_section(seed, False, Usual())[1], radius_mm=radius_mm, drift=0.0)
    return simulate(seed, False, section, Seen(incline_deg))


def measured(part: Part, **given: object) -> MilledEdge:
    root, bevel = max(0.5, round(2 * part.section.root_mm) / 2), 5.0 * round(part.section.bevel / DEG / 5.0)
    cloud = denoise(fuse(part.recording))
    return segment(cloud, root_nominal_mm=root, bevel_nominal_deg=bevel, **given)  # type: ignore[arg-type]


def errors(part: Part, edge: MilledEdge) -> Float:
    return edge.root.value[edge.seen] - part.section.root_mm


@cache
def plainly(seed: int, radius_mm: float, incline_deg: float) -> tuple[Part, MilledEdge]:
    """A part and its edge, of which nothing is declared but the nominal sizes."""
    part = rounded(seed, radius_mm, incline_deg)
    return part, measured(part)


def test_the_virtual_edge_lies_within_its_uncertainty() -> None:
    cases = [(3, 0.0, 25.0), (12, 0.3, 25.0), (12, 0.0, 45.0), (8, 0.3, 45.0)]
    found = [np.abs(errors(part, edge) / edge.root.u[edge.seen]).max() for part, edge in (plainly(*c) for c in cases)]
    assert np.median(found) < 2.0
    assert max(found) < 4.0


@pytest.mark.parametrize(
    ("seed", "radius_mm", "incline_deg"),
    [
        (3, 0.2, -8.0),
        *seldom((5, 0.25, -18.0), (5, 0.0, -12.0), (8, 0.1, -8.0), (8, 0.1, -12.0), (3, 0.25, -12.0)),
    ],
)
def test_a_view_from_below_sees_all_of_a_rounding(seed: int, radius_mm: float, incline_deg: float) -> None:
    """And some or all of the lower surface: the root face came out up to its radius too long, or the bevel for it."""
    part, edge = plainly(seed, radius_mm, incline_deg)
    off = errors(part, edge)
    assert np.abs(off).max() < 0.02
    assert np.abs(off / edge.root.u[edge.seen]).max() < 3.0


def seen_from_below(drawn: Drawn) -> tuple[MilledEdge, Float]:
    """The edge, and the errors of its root face where it is seen."""
    names = {"upper_side", "root_nominal_mm", "bevel_nominal_deg"}.intersection(drawn.declared)
    edge = segment(denoise(fuse(drawn.recording)), **{name: drawn.declared[name] for name in names})
    true = np.asarray(drawn.truth["position_mm"])
    near = ((edge.position_mm[edge.seen][:, None] - true) ** 2).sum(axis=2).argmin(axis=1)
    return edge, edge.root.value[edge.seen] - np.asarray(drawn.truth["root_mm"])[near]


@pytest.mark.parametrize(
    ("draw", "seed", "radius_mm"),
    [(outside_below, 2515, 0.277), *seldom((triangulated_below, 2511, 0.240), (triangulated_below, 2508, 0.235))],
)
def test_a_rounding_between_root_face_and_lower_surface_is_measured(
    draw: Callable[[int], Drawn], seed: int, radius_mm: float
) -> None:
    """It was refused as a corner in the root face, or turned that face's line."""
    edge, off = seen_from_below(draw(seed))
    assert np.abs(off).max() < 0.004
    assert np.abs(off / edge.root.u[edge.seen]).max() < 3.0
    found = next(check.value for check in edge.checks if check.name == "edge_break_mm")
    assert found == pytest.approx(radius_mm, rel=0.05)


def test_a_rounding_that_is_seen_is_told_with_its_radius() -> None:
    edge = plainly(3, 0.25, 25.0)[1]
    assert any("rounded or chamfered, by about 0.2" in one for one in edge.warnings)
    assert not any("rounded" in one for one in plainly(3, 0.0, 25.0)[1].warnings)


def test_u_grows_as_the_view_hides_more_of_a_rounding() -> None:
    u = [float(np.nanmedian(plainly(3, 0.0, at)[1].root.u)) for at in (25.0, 42.0, 58.0)]
    assert u[0] < u[1] < u[2]


def test_what_is_declared_of_the_edge_is_a_prior() -> None:
    """A sharp edge is known better where it is declared; one that was broken is not taken for sharp."""
    part = rounded(8, 0.0, 50.0)
    sharp, unknown, deburred = (measured(part, edge_condition=one) for one in ("sharp", "unknown", "deburred"))
    assert np.nanmedian(sharp.root.u) < 0.5 * np.nanmedian(unknown.root.u)
    assert np.nanmedian(sharp.root.value) < np.nanmedian(unknown.root.value) < np.nanmedian(deburred.root.value)
    assert np.abs(errors(part, sharp)).max() < 0.01


@pytest.mark.parametrize(("threshold", "footprint"), [(0.05, 1.5), *seldom((0.1, 0.8))])
def test_the_fill_at_which_a_pixel_returns_is_told_by_its_depth(threshold: float, footprint: float) -> None:
    """Taken for half a pixel, a quarter of it put the end 0.02 mm too far.

    The root face returns a fifth of the median brightness, of which `threshold` is a share.
    """
    section = workpiece(np.random.default_rng(4), "milled", 4)
    led, wide = way(np.random.default_rng(5), section, 48.0)
    eye = replace(sensor(np.random.default_rng(6), wide), threshold=threshold, footprint=footprint, bright=False)
    drawn = triangulated(section, eye, [led], 4)
    nominal = {"root_nominal_mm": section.root_mm.mean, "bevel_nominal_deg": section.bevel.mean / DEG}
    edge = segment(denoise(fuse(drawn.recording)), edge_condition="sharp", **nominal)
    true = np.asarray(drawn.truth["position_mm"])
    near = ((edge.position_mm[edge.seen][:, None] - true) ** 2).sum(axis=2).argmin(axis=1)
    off = edge.root.value[edge.seen] - np.asarray(drawn.truth["root_mm"])[near]
    assert np.abs(off / edge.root.u[edge.seen]).max() < 3.0
    assert np.abs(off).max() < 0.015


@pytest.mark.parametrize("seed", [9_643_006, *seldom(13_800_007)])
def test_a_lower_surface_that_returns_in_half_of_the_frames_is_not_the_root_face(seed: int, tmp_path: Path) -> None:
    """Seen from below in a radius of 0.25 mm; its returns, up to 2 mm beyond the edge, were taken for its break."""
    found = one(("below", "triangulated", seed, tmp_path, "product")).found["root_mm"]
    assert np.abs(found.error / found.u).max() < 3.0
    assert found.u.max() < 0.03
