"""What shortens the end of a raw edge's face without being it: a shadow beside a clamp, the robot's errors."""

from __future__ import annotations

import numpy as np

from bench.score import analytic, swept, triangulated
from bench.score.measure import alone


def test_a_shadow_that_runs_across_the_face_beside_a_clamp_is_no_edge() -> None:
    """Over 7 mm the face shows less and less of itself: its end was followed, 5.3 mm and 47 deg off, at up to 32 u."""
    found = alone(swept.raw(11_000_009)).found
    for name, most in (("along_m_mm", 0.07), ("heading_deg", 0.25)):
        assert (np.abs(found[name].error) / found[name].u).max() < 2.5, name
        assert np.abs(found[name].error).max() < most, name


def test_ends_that_go_with_the_robot_s_errors_are_neither_burrs_nor_gouges() -> None:
    """Errors of 0.04 mm over 2 mm, declared: shorter and longer ends were followed, 0.6 deg off at 8.5 u."""
    found = alone(triangulated.raw(11_500_001)).found["heading_deg"]
    assert np.abs(found.error).max() < 0.25


def test_how_a_rough_face_winds_is_in_the_u_of_its_edge_s_direction() -> None:
    """Its local plane, over 20 mm, turns by 0.15 deg beside the course, whose u was 0.05: 7 u off."""
    found = alone(analytic.raw(11_720_014)).found["heading_deg"]
    assert (np.abs(found.error) / found.u).max() < 2.5
    assert np.abs(found.error).max() < 0.4


def test_where_a_clamp_s_shadow_leaves_less_than_half_of_the_face_no_edge_is_told() -> None:
    """Its upper quarter alone, over 5 mm: the end of the shadow was the edge, 8 mm above it, and every u grew."""
    found = alone(analytic.raw(19_100_009)).found
    for name, most in (("along_m_mm", 0.15), ("heading_deg", 0.5)):
        assert np.abs(found[name].error).max() < most, name
        assert (np.abs(found[name].error) / found[name].u).max() < 3.0, name
    assert np.median(found["along_m_mm"].u) < 0.1
