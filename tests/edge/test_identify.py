"""Which faces of a profile are root face and bevel face: every way to look at an edge, and what only looks like one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.edge.identify import Candidate, candidates, vote
from workbench.geometry.chains import straight_faces
from workbench.units import DEG, Float

ROOT_MM, BEVEL_DEG, THICKNESS_MM, PITCH_MM = 1.5, 40.0, 8.0, 0.05


def outline(root_mm: float = ROOT_MM, bevel_deg: float = BEVEL_DEG, upper_mm: float = 12.0) -> Float:
    """Corners (outwards, up) of a milled edge's section, from far on the upper surface to far on the lower one."""
    back = (THICKNESS_MM - root_mm) * math.tan(bevel_deg * DEG)
    return np.array([[-back - upper_mm, THICKNESS_MM], [-back, THICKNESS_MM], [0, root_mm], [0, 0], [-12, 0]])


def profile(
    corners: Float, elevation_deg: float, side: int, sense: int, seed: int = 0, table: bool = True
) -> tuple[Float, Float]:
    """x (rising) and z of the returns: the sensor looks from `elevation_deg`, lower side at rising side * x."""
    view = np.array([math.cos(elevation_deg * DEG), math.sin(elevation_deg * DEG)])
    lateral = side * (corners @ [view[1], -view[0]])
    away = -(corners @ view)
    xs, zs = [], []
    for i in range(len(corners) - 1):
        if side * (lateral[i + 1] - lateral[i]) < 0.2:  # turned away from the sensor
            continue
        x = np.arange(math.ceil(min(lateral[i : i + 2]) / PITCH_MM), max(lateral[i : i + 2]) / PITCH_MM) * PITCH_MM
        xs.append(x)
        zs.append(away[i] + (away[i + 1] - away[i]) * (x - lateral[i]) / (lateral[i + 1] - lateral[i]))
    if table:  # something flat, far behind the lower edge
        end = max((side * x).max() for x in xs if x.size)
        x = side * np.arange(end + 0.5, end + 6, PITCH_MM)
        xs.append(x)
        zs.append(np.full(x.size, away.max() + 20) + 0.2 * x)
    x, z = np.concatenate(xs), np.concatenate(zs)
    order = np.argsort(x)
    z = z + np.random.default_rng(seed).normal(0, 0.012, z.size)
    return x[order] + 3.0, sense * (z[order] + 150.0)


def read(x: Float, z: Float, cut: tuple[bool, bool] = (False, False)) -> list[Candidate]:
    return list(candidates(straight_faces(x, z), np.array(cut), ROOT_MM, BEVEL_DEG * DEG))


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(
    ("elevation_deg", "upper", "lower"),
    [(60, True, False), (35, True, False), (12, True, False), (0, False, False), (-25, False, True)],
)
def test_every_view(elevation_deg: float, upper: bool, lower: bool, side: int, sense: int) -> None:
    """From above with the upper surface, square with neither, from below with the lower one; mirrored; z reversed."""
    found = read(*profile(outline(), elevation_deg, side, sense))
    assert vote([found]) == (side, sense)
    best = min(found, key=lambda c: c.score)
    assert (best.side, best.sense) == (side, sense)
    assert (best.upper is not None, best.lower is not None) == (upper, lower)
    # The root face lies `elevation` off the range axis' normal, the bevel face by the bevel angle more.
    root, bevel = (side * sense * math.atan(line[0]) / DEG for line in (best.root, best.bevel))
    assert root == pytest.approx(elevation_deg, abs=1.0)
    assert bevel == pytest.approx(elevation_deg - BEVEL_DEG, abs=1.0)
    corner = (best.root[1] - best.bevel[1]) / (best.bevel[0] - best.root[0])
    width = abs(best.root[2] - corner) / math.cos(elevation_deg * DEG)
    assert width == pytest.approx(ROOT_MM, abs=0.15)
    assert side * (best.root[2] - corner) > 0


def test_two_wide_faces_at_the_bevel_angle_are_a_bent_sheet() -> None:
    lean = BEVEL_DEG * DEG
    wide = np.array([[-25 * math.sin(lean), 25 * math.cos(lean)], [0, 0], [0, -25.0]])
    assert vote([read(*profile(wide, 15, 1, 1))]) is None


@pytest.mark.parametrize("bevel_deg", [40.0, 45.0, 50.0])
@pytest.mark.parametrize("side", [1, -1])
def test_the_upper_surface_at_the_fields_limit_is_not_the_root_face(bevel_deg: float, side: int) -> None:
    """The trap: 1.5 mm of upper surface in view join the bevel face at about the bevel angle, too."""
    found = []
    for seed in range(5):
        x, z = profile(outline(bevel_deg=bevel_deg, upper_mm=1.5), 35, side, 1, seed)
        found.append(read(x, z, cut=(side > 0, side < 0)))
    assert vote(found) == (side, 1)
    best = min(found[0], key=lambda c: c.score)
    assert side * math.atan(best.root[0]) / DEG == pytest.approx(35, abs=1.5)


def test_a_root_face_cut_off_by_the_field_counts_for_less() -> None:
    x, z = profile(outline(), 35, 1, 1, table=False)
    whole, cut = read(x, z), read(x, z, cut=(False, True))
    assert min(c.score for c in cut) > min(c.score for c in whole) + 3
    elsewhere = read(x, z, cut=(True, False))
    assert min(c.score for c in elsewhere) == min(c.score for c in whole)
