"""Which faces of a profile are root face and bevel face: every way to look at an edge, and what only looks like one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.edge.identify import Candidate, candidates, crossing, joined, turn, vote
from workbench.geometry.chains import COUNT, straight_faces
from workbench.units import DEG, AnyArray, Float

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


@pytest.mark.parametrize(("root_mm", "bevel_deg"), [(0.8, 30.0), (3.0, 30.0), (0.8, 50.0), (3.0, 50.0)])
@pytest.mark.parametrize("elevation_deg", [50, -15])
def test_sizes_and_angles_far_from_nominal(root_mm: float, bevel_deg: float, elevation_deg: float) -> None:
    found = read(*profile(outline(root_mm, bevel_deg), elevation_deg, 1, -1))
    best = min(found, key=lambda c: c.score)
    assert (best.side, best.sense) == (1, -1)
    assert math.atan(best.root[0]) - math.atan(best.bevel[0]) == pytest.approx(-bevel_deg * DEG, abs=0.03)


@pytest.mark.parametrize("elevation_deg", [20, 45, 70])
@pytest.mark.parametrize("sense", [1, -1])
def test_a_square_edge_is_no_bevel(elevation_deg: float, sense: int) -> None:
    corners = np.array([[-15.0, 8], [0, 8], [0, 0], [-12, 0]])
    assert vote([read(*profile(corners, elevation_deg, 1, sense))]) is None
    thin = np.array([[-15.0, 1.5], [0, 1.5], [0, 0], [-12, 0]])  # an end face as narrow as a root face
    assert vote([read(*profile(thin, elevation_deg, 1, sense))]) is None


def test_a_plate_is_no_edge() -> None:
    for table in (False, True):
        flat = np.array([[-15.0, 0.0], [15.0, 0.0]])
        assert vote([read(*profile(flat, 80, 1, 1, table=table))]) is None
    nothing = np.empty((0, 7))
    assert list(candidates(nothing, np.zeros(2, bool), ROOT_MM, BEVEL_DEG * DEG)) == []


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


def test_short_lines_of_stray_returns_between_the_faces_are_passed_over() -> None:
    x, z = profile(outline(), 35, 1, 1)
    chain = straight_faces(x, z)
    short = chain[1].copy()
    short[COUNT] = 6
    with_strays = np.concatenate([chain[:2], [short, short], chain[2:]])
    plain, passed = (list(candidates(c, np.zeros(2, bool), ROOT_MM, BEVEL_DEG * DEG)) for c in (chain, with_strays))
    assert min(c.score for c in passed) == pytest.approx(min(c.score for c in plain))
    assert vote([passed]) == (1, 1)


def reading(side: int, sense: int, score: float) -> Candidate:
    line = np.zeros(3)
    return Candidate(score, side, sense, None, line, line, None)


def test_key_frames_vote() -> None:
    """Many frames that agree outvote some that are sure of something else; a frame has one vote for each reading."""
    assert vote([]) is None
    assert vote([[], []]) is None
    frames = [[reading(1, 1, 2.0), reading(-1, 1, 4.5)]] * 6 + [[reading(-1, 1, -2.0)]] * 2
    assert vote(frames) == (1, 1)
    assert vote(frames[4:]) == (-1, 1)
    assert vote([[reading(-1, -1, 5.0)] * 9, [reading(1, -1, 3.0)]]) == (1, -1)


def test_corners_of_two_lines() -> None:
    a = np.array([0.0, 4.0, 0.5, 1.0, 80, 0, 79])
    b = np.array([4.05, 9.0, -1.0, 7.0, 100, 80, 179])
    assert crossing(a, b) == pytest.approx(4.0)
    assert turn(a, b, 1) == pytest.approx(-math.pi / 4 - math.atan(0.5))
    assert turn(a, b, -1) == -turn(a, b, 1)
    assert joined(a, b)
    assert not joined(a, b + np.array([0, 0, 0, 1.5, 0, 0, 0]))  # they cross 1 mm further on: a step, no corner
    assert math.isnan(crossing(a, a))
    assert not joined(a, a + np.array([4.05, 5, 0, 0.3, 0, 0, 0]))


def test_reading_does_not_change_the_chain() -> None:
    chain: AnyArray = straight_faces(*profile(outline(), 35, 1, 1))
    before = chain.copy()
    list(candidates(chain, np.zeros(2, bool), ROOT_MM, BEVEL_DEG * DEG))
    np.testing.assert_array_equal(chain, before)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("offset_mm", [0.27, -0.27])
def test_a_face_goes_on_beyond_second_returns(side: int, offset_mm: float) -> None:
    """A ghost in the middle of the bevel leaves a piece beside the upper surface, which could pass for a root face."""
    corners = outline(root_mm=1.6, bevel_deg=42.7)
    x, z = profile(corners, 55.0, side, 1, table=False)
    view = np.array([math.cos(55.0 * DEG), math.sin(55.0 * DEG)])
    ends = np.sort(side * (corners[1:3] @ [view[1], -view[0]]) + 3.0)
    share = (x - ends[0]) / (ends[1] - ends[0])
    lower = share if side > 0 else 1.0 - share
    z = z + offset_mm * ((lower > 0.25) & (lower < 0.5))
    found = min(candidates(straight_faces(x, z), np.array([False, False]), 2.0, 45.0 * DEG), key=lambda one: one.score)
    assert (found.side, found.sense) == (side, 1)
    corner = (found.root[1] - found.bevel[1]) / (found.bevel[0] - found.root[0])
    assert abs(corner - (side * float(corners[2] @ [view[1], -view[0]]) + 3.0)) < 0.03
