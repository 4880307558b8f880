"""Slicing a cloud across a course."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from workbench.geometry.curves import with_frame
from workbench.geometry.slices import MARGIN, cut, lay_out
from workbench.geometry.splines import Spline

RADIUS = 300.0


def on_ring(angle, radius, height):
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def test_a_ring_becomes_straight_and_each_cell_keeps_what_lies_in_front():
    rng = np.random.default_rng(2)
    angle = rng.uniform(0.0, 0.3, 60_000)
    height = rng.uniform(-3.0, 3.0, angle.size)
    behind = rng.random(angle.size) < 0.3
    points = on_ring(angle, np.where(behind, RADIUS - 4.0, RADIUS + 0.2 * height), height)
    at = np.linspace(-0.05, 0.35, 60)
    spline = make_interp_spline(at * RADIUS, on_ring(at, RADIUS, 0.0 * at))
    course = with_frame(Spline(spline.t, spline.c), at * RADIUS)
    laid = lay_out(points, course, angle * RADIUS + 0.4)
    np.testing.assert_allclose(laid.s, angle * RADIUS, atol=1e-3)
    middle = course.position(np.array([0.15 * RADIUS]))[0]
    x, z, pose = cut(laid, -middle / RADIUS, np.arange(5.0, 85.0, 0.4), 0.4, 0.1)
    kept = np.isfinite(x)
    assert kept[:, MARGIN + 1 : -MARGIN - 2].mean() > 0.95
    assert not kept[:, : MARGIN - 1].any()
    assert not kept[:, -MARGIN:].any()
    front = z[kept] < 2.0
    assert front.mean() > 0.95, "what lies 4 mm behind shows through gaps only"
    np.testing.assert_allclose(np.abs(z[kept][front]), 0.2 * np.abs(x[kept][front]), atol=2e-3)
    np.testing.assert_allclose(np.linalg.det(pose[:, :3, :3]), 1.0, atol=1e-12)
    tangent = course.tangent(np.arange(5.0, 85.0, 0.4))
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", pose[:, :3, 1], tangent)), 1.0, atol=1e-9)
