"""Rays on a part with a cut face of any shape: against its own height function, sampled densely."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.synthetic import parse_recipe, raycast
from workbench.synthetic.workpiece import Cut, build_surface
from workbench.units import DEG

LENGTH, ROOT, BEVEL = 40.0, 1.5, 40 * DEG
U_STEP, W_STEP, W_FIRST = 0.25, 0.25, -3.0
CURVES = ({}, {"shape": "arc", "radius_mm": 150, "sense": "concave"}, {"shape": "wavy", "wavelength_mm": 120})


def cut_part(curve, heights, **more):
    """A raw part with the cut height(u, w) over the bevel plane."""
    document = {"kind": "raw", "length_mm": LENGTH, "curve": curve, **more}
    part = parse_recipe({"part": document, "passes": [{"from_mm": 0, "to_mm": 1}]}).part
    u, w = np.arange(0, LENGTH + U_STEP / 2, U_STEP), np.arange(W_FIRST, 12, W_STEP)
    stock = np.full((len(u), len(w)), 5.0)
    return build_surface(part, 3, Cut(heights(u[:, None], w), stock, U_STEP, W_FIRST, W_STEP, ROOT, BEVEL, 1))


def hills(u, w):
    """Hills of half a mm with slopes up to one."""
    return 0.3 * np.sin(2 * np.pi * u / 3.1) * np.cos(2 * np.pi * w / 4.3) + 0.2 * np.sin(2 * np.pi * u / 1.9)


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("twist_deg", [0.0, 15.0])
def test_slopes_are_those_of_the_body(curve, twist_deg):
    surface = cut_part(curve, hills, end_face_tilt_deg=3, end_face_twist_deg=twist_deg)
    rng, step, on_cut = np.random.default_rng(0), 1e-6, 0
    for u, h, z in zip(rng.uniform(2, 38, 60), rng.uniform(-6, 1, 60), rng.uniform(1, 8, 60), strict=True):
        _, face, *slopes = raycast.body(surface, u, h, z)
        on_cut += face == raycast.BEVEL
        for slope, shift in zip(slopes, np.eye(3) * step, strict=True):
            high, low = (raycast.body(surface, *(np.array([u, h, z]) + s))[0] for s in (shift, -shift))
            assert slope == pytest.approx((high - low) / (2 * step), abs=1e-5)
    assert on_cut > 20


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize(("roughness_mm", "twist_deg"), [(0.0, 0.0), (0.1, 0.0), (0.0, 12.0)])
def test_rays_stop_where_the_body_begins(curve, roughness_mm, twist_deg):
    """The first point with F <= 0 on each ray, found by looking every 0.005 mm; grazing rays among them."""
    surface = cut_part(curve, hills, roughness_mm=roughness_mm, end_face_twist_deg=twist_deg)
    rng, hits, late = np.random.default_rng(1), 0, 0
    ways = np.arange(0, 30, 0.005)
    for _ in range(40):
        x, y, tx, ty = raycast.edge_point(surface, rng.uniform(8, 32))
        outward = np.array([ty, -tx, 0.0])
        target = np.array([x, y, 0]) + rng.uniform(-5, 0) * outward + [0, 0, rng.uniform(0.5, 7.5)]
        away = rng.normal(size=3) * (0.6, 0.6, 0.3) + 0.7 * outward + [0, 0, 0.8]
        away /= np.linalg.norm(away)
        start = target + 14 * away
        a, face, u, _, cosine = raycast.enter(surface, np.array([x, y, ty, -tx]), tuple(start), tuple(-away), 0.0, 30.0)
        along = raycast.project_all(surface, start - ways[:, None] * away)
        values = np.array(
            [raycast.body(surface, *at[:2], z)[0] for at, z in zip(along, start[2] - ways * away[2], strict=True)]
        )
        first = ways[np.argmax(values <= 0)] if (values <= 0).any() else np.inf
        if np.isinf(first) and np.isinf(a):
            continue
        hits += face == raycast.BEVEL
        late += not first - 0.02 < a <= first + 1e-6  # a corner may be thinner than the samples
        if np.isfinite(a):
            at = start - a * away
            u_at, h_at = raycast.project_all(surface, at[None])[0, :2]
            assert abs(raycast.body(surface, u_at, h_at, at[2])[0]) < 1e-8
            assert u == pytest.approx(u_at)
            assert 0 < cosine <= 1
    assert hits > 20
    assert late <= 1


def test_incidence_on_an_even_cut_face():
    """A face 2 mm over the plane, seen along its normal and 60 deg off it."""
    surface = cut_part({}, lambda u, w: np.full((u + w).shape, 2.0))
    b, t = np.array([0, -np.cos(BEVEL), np.sin(BEVEL)]), np.array([1.0, 0, 0])
    middle = np.array([20.0, 0, ROOT]) + 2.0 * b + 3.0 * np.array([0, np.sin(BEVEL), np.cos(BEVEL)])
    for away, cosine in ((b, 1.0), (0.5 * b + np.sqrt(0.75) * t, 0.5)):
        found = raycast.enter(surface, np.array([20.0, 0, 0, -1]), tuple(middle + 8 * away), tuple(-away), 0.0, 30.0)
        assert found[:2] == pytest.approx((8.0, raycast.BEVEL), abs=1e-9)
        assert found[4] == pytest.approx(cosine, abs=1e-9)


def test_what_was_not_cut_is_the_raw_part():
    """A cut above all stock changes no ray."""
    high = cut_part({}, lambda u, w: np.full((u + w).shape, np.inf), roughness_mm=0.1)
    raw = high._replace(cut=raycast.UNCUT)
    near = np.array([20.0, 0, 0, -1])
    for z in np.linspace(0.2, 7.9, 30):
        one, other = (raycast.enter(s, near, (20.0, -12.0, z), (0.0, 1.0, -0.1), 0.0, 30.0) for s in (high, raw))
        assert one[:2] == pytest.approx(other[:2], abs=1e-8)
