"""Pictures of clouds: what is nearest shows, where a camera puts it, in its own colour; and fast."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests.shapes import unchecked
from workbench.geometry.splat import Camera, draw_cloud, spacing_px

RED, BLUE, WHITE = (200, 30, 30), (30, 60, 200), (255, 255, 255)


def camera(*, width=120, height=80, scale=4.0, look=(0.0, 0.0, 1.0), up=(0.0, 1.0, 0.0), **more):
    towards = np.array(look) / np.linalg.norm(look)
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return Camera(np.array([right, np.cross(towards, right), towards]), np.zeros(3), scale, width, height, **more)


def plate(z_mm=0.0, half_mm=(10.0, 6.0), pitch_mm=0.1):
    """Points of a rectangle about the origin, parallel to x and y."""
    axes = [np.arange(-half, half + 1e-9, pitch_mm) for half in half_mm]
    x, y = (each.ravel() for each in np.meshgrid(*axes))
    return np.column_stack([x, y, np.full_like(x, z_mm)])


def painted(points, colour):
    return np.tile(np.array(colour, np.uint8), (len(points), 1))


def test_a_plate_covers_its_rectangle_in_its_colour():
    points = plate()
    drawn = draw_cloud(points, painted(points, RED), camera())
    inside = drawn.rgb[18:62, 22:98]
    np.testing.assert_array_equal(inside, np.broadcast_to(RED, inside.shape))
    outside = drawn.rgb.copy()
    outside[14:66, 18:102] = WHITE
    np.testing.assert_array_equal(outside, np.broadcast_to(WHITE, outside.shape))
    np.testing.assert_allclose(drawn.near_mm[18:62, 22:98], 0.0, atol=1e-5)
    assert np.isnan(drawn.near_mm[0, 0])


@pytest.mark.parametrize("order", [1, -1])
def test_what_is_nearer_hides_what_is_farther_in_any_order(order):
    near, far = plate(2.0, (4.0, 4.0)), plate(-2.0)
    points, colour = np.vstack([near, far]), np.vstack([painted(near, BLUE), painted(far, RED)])
    drawn = draw_cloud(points[::order], colour[::order], camera())
    np.testing.assert_array_equal(drawn.rgb[40, 60], BLUE)
    np.testing.assert_array_equal(drawn.rgb[40, 92], RED)
    assert drawn.near_mm[40, 60] == pytest.approx(2.0, abs=1e-5)
    assert drawn.near_mm[40, 92] == pytest.approx(-2.0, abs=1e-5)
    back = draw_cloud(points, colour, camera(look=(0.0, 0.0, -1.0)))
    np.testing.assert_array_equal(back.rgb[40, 60], RED)


@pytest.mark.parametrize("distance_mm", [math.inf, 60.0])
def test_points_are_drawn_where_the_camera_projects_them(distance_mm):
    rng = np.random.default_rng(3)
    view = camera(look=(0.3, -0.8, 0.5), up=(0.0, 0.0, 1.0), width=400, height=300, scale=12.0, distance_mm=distance_mm)
    for place in rng.uniform(-8.0, 8.0, (20, 3)):
        drawn = draw_cloud(place[None], painted(place[None], RED), view, size_px=3.0)
        rows, columns = np.nonzero(drawn.rgb[..., 1] < 255)
        column, row, near = view.project(place[None])[0]
        assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx((column, row), abs=0.6)
        assert np.nanmax(drawn.near_mm) == pytest.approx(near, abs=1e-4)


def test_perspective_follows_similar_triangles():
    """A length at depth z appears as from a pinhole: f / (D - z), here D = 100 mm and f = 100 mm x 4 px/mm."""
    view = camera(width=800, height=600, distance_mm=100.0)
    for z in (-100.0, 0.0, 50.0):
        ends = view.project(np.array([[-3.0, 0.0, z], [3.0, 0.0, z]]))
        assert ends[1, 0] - ends[0, 0] == pytest.approx(6.0 * 400.0 / (100.0 - z))
    behind = np.array([[0.0, 0.0, 150.0]])
    assert np.all(draw_cloud(behind, painted(behind, RED), view).rgb == 255)


@pytest.mark.parametrize("inclination", [0.0, 0.5, 1.1])
def test_a_plane_keeps_its_colour_however_it_is_inclined(inclination):
    points = plate(pitch_mm=0.05)
    drawn = draw_cloud(points, painted(points, RED), camera(look=(0.0, math.sin(inclination), math.cos(inclination))))
    middle = drawn.rgb[37:43, 40:80].astype(int)
    assert np.abs(middle - RED).max() < 40
    assert np.abs(middle.mean(axis=(0, 1)) - RED).max() < 20


def test_a_step_is_seen():
    """Eye-dome lighting: dark on the lower side along the outline of what stands before it."""
    high, low = plate(3.0, (4.0, 4.0), 0.05), plate(-3.0, pitch_mm=0.05)
    points = np.vstack([high, low])
    drawn = draw_cloud(points, painted(points, RED), camera(scale=8.0, width=200, height=120)).rgb[..., 0].astype(int)
    along = drawn[60, 20:180]
    edge = np.abs(np.arange(20, 180) - 100 - 32) <= 4
    assert along[edge].min() < 0.7 * np.median(along)


def test_points_without_a_place_are_left_out():
    points = plate()
    points[::7] = np.nan
    points[3] = np.inf
    drawn = draw_cloud(points, painted(points, RED), camera())
    np.testing.assert_array_equal(drawn.rgb[40, 60], RED)
    nothing = draw_cloud(np.full((5, 3), np.nan), painted(np.zeros((5, 3)), RED), camera())
    assert np.all(nothing.rgb == 255)
    assert np.all(draw_cloud(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), camera()).rgb == 255)


@pytest.mark.parametrize("pitch_mm", [0.05, 0.3, 0.65])
def test_the_spacing_on_the_screen_is_found(pitch_mm):
    points = plate(half_mm=(30.0, 20.0), pitch_mm=pitch_mm)
    view = camera(width=800, height=600, scale=10.0)
    assert spacing_px(points, view) == pytest.approx(10.0 * pitch_mm, rel=0.15)
    assert np.mean(draw_cloud(points, painted(points, RED), view).rgb[150:450, 150:650, 1] > 200) < 0.02


def test_blocks_do_not_show(monkeypatch):
    """As many buffers as cores, merged: the same picture with one."""
    points = np.random.default_rng(1).uniform(-8.0, 8.0, (50_000, 3))
    colour = np.random.default_rng(2).integers(0, 255, points.shape).astype(np.uint8)
    pictures = []
    for count in (1, 5):
        monkeypatch.setattr("workbench.geometry.splat.cores", lambda count=count: count)
        monkeypatch.setattr("workbench.geometry.blocks.cores", lambda count=count: count)
        pictures.append(draw_cloud(points, colour, camera()))
    np.testing.assert_array_equal(pictures[0].rgb, pictures[1].rgb)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="are \\(n, 3\\)"):
        unchecked(draw_cloud)(np.zeros((3, 3)), np.zeros((2, 3), np.uint8), camera())
    assert dataclasses.replace(camera(), width_px=10).finer(2).width_px == 20
