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


def test_incidence_on_an_even_cut_face():
    """A face 2 mm over the plane, seen along its normal and 60 deg off it."""
    surface = cut_part({}, lambda u, w: np.full((u + w).shape, 2.0))
    b, t = np.array([0, -np.cos(BEVEL), np.sin(BEVEL)]), np.array([1.0, 0, 0])
    middle = np.array([20.0, 0, ROOT]) + 2.0 * b + 3.0 * np.array([0, np.sin(BEVEL), np.cos(BEVEL)])
    for away, cosine in ((b, 1.0), (0.5 * b + np.sqrt(0.75) * t, 0.5)):
        found = raycast.enter(surface, np.array([20.0, 0, 0, -1]), tuple(middle + 8 * away), tuple(-away), 0.0, 30.0)
        assert found[:2] == pytest.approx((8.0, raycast.BEVEL), abs=1e-9)
        assert found[4] == pytest.approx(cosine, abs=1e-9)
