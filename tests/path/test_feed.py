"""The feed against equation (26) by hand: distances to every point that still stands."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.path.conftest import Raw
from workbench.api import rotation_from_quaternion
from workbench.artefacts import Layer, Toolpath, Travel
from workbench.errors import InputError
from workbench.path import feed, layers
from workbench.units import DEG, Float


def cloud_points(scan: Raw) -> Float:
    """All kept points in the base, float64."""
    rows, columns = np.nonzero(scan.cloud.keep)
    x, z = (v[rows, columns].astype(np.float64)[:, None] for v in (scan.cloud.x_mm, scan.cloud.z_mm))
    pose = scan.cloud.base_from_profiler[rows]
    return np.asarray(pose[:, :3, 0] * x + pose[:, :3, 2] * z + pose[:, :3, 3])


def to_segments(points: Float, start: Float, end: Float) -> Float:
    """Least distance of each segment (k, 3) to points (n, 3)."""
    out = []
    for a, b in zip(start, end, strict=True):
        along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        out.append(np.linalg.norm(points - a - along[:, None] * (b - a), axis=1).min())
    return np.array(out)


def axis_of(path: Toolpath, points: Layer | Travel) -> tuple[Float, Float]:
    turn = rotation_from_quaternion(points.quaternion_wxyz)
    centre = points.position_mm - path.cutter.diameter_mm / 2 * turn[:, :, 0]
    half = path.cutter.flute_length_mm / 2 * turn[:, :, 2]
    return centre - half, centre + half


def equation_26(distance_mm: Float, radius_mm: float = 5.0, slow: float = 1.0, fast: float = 20.0) -> Float:
    return (fast - slow) / (1 + np.exp(-0.5 * (distance_mm - 10.0 - radius_mm))) + slow


def test_distances_are_those_to_all_points_that_still_stand(raw: Callable[..., Raw]) -> None:
    """A straight edge, where "above an earlier layer's face" is a plane for the whole part."""
    scan = raw(part={"length_mm": 44.0}, passes=[{"from_mm": -2.0, "to_mm": 46.0}], scanner={"columns": 400})
    path = feed(layers(scan.edge, scan.cloud), scan.cloud, scan.edge, acceleration_mm_s2=1e5)
    points = cloud_points(scan)
    p, t, n, m = (v[0] for v in (scan.edge.position_mm, scan.edge.tangent, scan.edge.normal, scan.edge.across))
    height = (points - p - 1.5 * m) @ (n * math.cos(40 * DEG) + m * math.sin(40 * DEG))
    along = (points - p) @ t
    over = (along >= -0.5) & (along <= path.edge_length_mm + 0.5)  # the cuts reach half a station beyond the ends
    for done, layer in enumerate(path.layers):
        gone = over & (height > path.layers[done - 1].height_mm) if done else np.zeros(len(points), bool)
        every = slice(None, None, 3)
        start, end = (v[every] for v in axis_of(path, layer))
        true = to_segments(points[~gone], start, end)
        found, cut = layer.feed_mm_s[every], layer.cutting[every]
        assert (found[cut] == 1.0).all()
        away = ~cut & (np.arange(len(cut)) > 0)  # the first point's feed is that of the travel before it
        assert (found[away] <= equation_26(true[away]) + 1e-6).all()
        near = true
        if done:  # the face before may be nearer than any point, and is as near as its lines say
            before = path.layers[done - 1]
            side = before.width_mm[:, None] / 2 * rotation_from_quaternion(before.quaternion_wxyz)[:, :, 2]
            lines = np.concatenate([before.position_mm + f * side for f in np.linspace(-1, 1, 201)])
            near = np.minimum(true, to_segments(lines[np.tile(before.cutting, 201)], start, end))
        assert found[away] == pytest.approx(equation_26(near[away]), rel=0.01)


@pytest.mark.parametrize("acceleration", [5.0, 50.0])
def test_feed_is_slow_in_the_material_and_respects_the_acceleration(raw, acceleration):
    scan = raw()
    path = feed(layers(scan.edge, scan.cloud), scan.cloud, scan.edge, acceleration_mm_s2=acceleration)
    moves: list[Layer | Travel] = [path.travels[0]]
    for layer, travel in zip(path.layers, path.travels[1:], strict=True):
        moves += [layer, travel]
    position, v = (np.concatenate([getattr(p, name) for p in moves]) for name in ("position_mm", "feed_mm_s"))
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert (np.abs(np.diff(v**2)) / 2 <= acceleration * step + 1e-9).all()
    assert v.min() >= 1.0
    assert v.max() <= 20.0
    for layer in path.layers:
        np.testing.assert_array_equal(layer.feed_mm_s[layer.cutting], 1.0)
    time = (step / v[1:]).sum()
    assert path.time_s == pytest.approx(time)
    assert path.time_at_v_slow_s == pytest.approx(step.sum())
    assert time < (0.6 if acceleration > 10 else 0.75) * step.sum()


def test_leads_beyond_a_scan_that_stops_on_the_edge_are_as_slow_as_the_cut(raw: Callable[..., Raw]) -> None:
    """The stock may go on there: nobody measured that it does not."""
    for beyond, slow in ((-12.0, True), (3.0, False)):
        scan = raw(part={"length_mm": 94.0}, passes=[{"from_mm": -beyond, "to_mm": 94.0 + beyond}])
        path = feed(layers(scan.edge, scan.cloud), scan.cloud, scan.edge, acceleration_mm_s2=1e5)
        final, length = path.layers[-1], path.edge_length_mm
        outside = np.maximum(-final.arc_length_mm, final.arc_length_mm - length)
        lead = (outside > 3.0) & (outside < 6.0)
        assert (final.feed_mm_s[lead] < 1.25).all() == slow


def test_feed_above_a_clamp_knows_the_clamp(raw: Callable[..., Raw]) -> None:
    clamped = {
        "part": {"length_mm": 94.0, "clamps": [{"from_mm": 35, "to_mm": 59, "height_mm": 12}]},
        "passes": [{"from_mm": 2.0, "to_mm": 92.0}],
    }
    scan = raw(**clamped)
    path = feed(layers(scan.edge, scan.cloud), scan.cloud, scan.edge)
    final = path.layers[-1]
    above = (final.arc_length_mm > 38) & (final.arc_length_mm < 54)
    assert (final.feed_mm_s[above] > 1.2).all()
    assert (final.feed_mm_s[above] < 6).all()  # 5 mm above the clamp, not 15 mm above the plate


def test_fast_below_slow_is_refused(raw: Callable[..., Raw]) -> None:
    scan = raw()
    with pytest.raises(InputError, match="v_fast_mm_s"):
        feed(layers(scan.edge, scan.cloud), scan.cloud, scan.edge, v_fast_mm_s=0.5)
