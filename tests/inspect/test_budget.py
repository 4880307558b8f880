"""The budget says what the combined standard uncertainty is made of."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.artefacts import UNKNOWN_PART, Part
from workbench.inspect.angles import BevelAngles
from workbench.inspect.budget import NO_HAND_EYE, budget
from workbench.inspect.roots import RootSizes
from workbench.units import DEG


@pytest.fixture
def measured() -> tuple[BevelAngles, RootSizes]:
    """Two sections: the first has the larger uncertainty of the root face, the second that of the bevel angle."""
    local, tilt, turned = np.array([0.1, 0.2]) * DEG, np.array([0.3, 0.3]) * DEG, np.array([0.05, 0.06]) * DEG
    angles = BevelAngles(np.full(2, 40 * DEG), np.sqrt(local**2 + tilt**2 + turned**2), local, tilt, 0.0, 0.0)
    parts = [np.array([u, 0.9 * u]) for u in (0.004, 0.003, 0.002, 0.001, 0.0005, 0.0)]
    return angles, RootSizes(np.full(2, 1.5), *parts)


def test_squares_of_the_sources_add_up_to_the_largest_section(measured: tuple[BevelAngles, RootSizes]) -> None:
    angles, roots = measured
    found = budget(angles, roots, UNKNOWN_PART).sources
    assert np.linalg.norm([one.root_u_mm for one in found]) == pytest.approx(roots.u_mm[0])
    assert np.linalg.norm([one.bevel_u_deg for one in found]) == pytest.approx(angles.u[1] / DEG)
    assert "agreement of scanning passes" not in [one.name for one in found]  # it adds nothing here


def test_what_is_left_out_is_said(measured: tuple[BevelAngles, RootSizes]) -> None:
    assert NO_HAND_EYE in budget(*measured, UNKNOWN_PART).not_included
    assert NO_HAND_EYE not in budget(*measured, Part(hand_eye_u_mm=0.05)).not_included


def test_nothing_measured_has_no_sources() -> None:
    none = np.zeros(0)
    angles = BevelAngles(none, none, none, none, 0.0, 0.0)
    assert budget(angles, RootSizes(*[none] * 7), UNKNOWN_PART).sources == ()
