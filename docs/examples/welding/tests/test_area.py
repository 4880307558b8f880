"""The area is that of the drawn groove; its uncertainty is the spread of random parts."""

import numpy as np
import pytest
from workbench_welding.area import Joint, groove_area_mm2, groove_area_u_mm2


def drawn_area_mm2(root, bevel, thickness, gap, bevelled_plates):
    """Shoelace formula over the corners of the groove."""
    width = (thickness - root) * np.tan(bevel)
    left, right = width, width * (bevelled_plates == 2)
    x = np.array([0, gap, gap, gap + right, -left, 0])
    y = np.array([0, 0, root, thickness, thickness, root])
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize("plates", [1, 2])
@pytest.mark.parametrize(("root", "bevel_deg", "thickness", "gap"), [(1.5, 40, 8, 2), (0, 30, 20, 3), (2, 10, 5, 0)])
def test_area_of_the_drawn_groove(root, bevel_deg, thickness, gap, plates):
    joint = Joint(thickness, 0, gap, 0, plates)
    area = groove_area_mm2(np.array([root]), np.radians([bevel_deg]), joint)
    assert area == pytest.approx(drawn_area_mm2(root, np.radians(bevel_deg), thickness, gap, plates))


@pytest.mark.parametrize("plates", [1, 2])
def test_uncertainty_is_the_spread_of_random_parts(plates):
    rng, n = np.random.default_rng(5), 20_000
    root, bevel = rng.normal(1.5, 0.03, n), np.radians(rng.normal(40, 0.4, n))
    thickness, gap = rng.normal(12, 0.05, n), rng.normal(2, 0.02, n)
    drawn = [drawn_area_mm2(*values, plates) for values in zip(root, bevel, thickness, gap, strict=True)]
    joint = Joint(12, 0.05, 2, 0.02, plates)
    stated = groove_area_u_mm2(np.array([1.5]), np.array([0.03]), np.radians([40]), np.radians([0.4]), joint)
    assert stated == pytest.approx(np.std(drawn), rel=0.03)
