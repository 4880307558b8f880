"""What a pixel sees of an end of a face."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.edge.broken_end import together_log
from workbench.edge.end_templates import (
    PRIORS,
    Depths,
    EndView,
    Pixels,
    end_phases,
    end_templates,
    free_depths,
    possible_pixels,
    rendered_end,
    seen_end,
)
from workbench.edge.last_returns import end_groups
from workbench.geometry.course import shares
from workbench.units import DEG

COLUMN_MM, FILL, LEAN, TURN = 0.05, 0.2, 25.0 * DEG, 45.0 * DEG


@pytest.mark.parametrize("height_mm", [0.0, 0.01, 0.05, 0.2])
def test_the_last_pixel_of_a_chamfer_gets_as_much_light_as_it_needs(height_mm: float) -> None:
    """Summed over what it sees: the chamfer's share by Lambert's law, beyond it the face's."""
    known = Depths(np.zeros(5), np.eye(5), np.zeros((5, 5)))
    edges = COLUMN_MM * np.arange(6.0)
    wide = Pixels(np.array([[1.0, FILL, 0.0]]), np.zeros(1, np.int64), np.ones(1))
    view = EndView(known, edges, LEAN, COLUMN_MM, end_phases(True), 0.0, 0.0, wide)
    one, first = np.ones(1), np.zeros(1, np.int64)
    _, _, past = rendered_end(view, height_mm * one, TURN * one, 85.0 * DEG * one, first, 0.0 * one)
    chamfer_mm = height_mm * (1.0 - np.tan(TURN) * np.tan(LEAN))
    within_mm = (np.arange(10_000) + 0.5) / 10_000 * COLUMN_MM - 0.5 * COLUMN_MM
    before_end = within_mm - past[0]
    light = np.where(before_end < chamfer_mm, np.cos(TURN + LEAN) / np.cos(LEAN), 1.0) * (before_end >= 0.0)
    assert light.mean() == pytest.approx(FILL, abs=2e-4)


def test_a_pixel_that_weighs_by_light_sees_less_of_a_rounding_and_a_nearer_end() -> None:
    """Lambert's law, by sums over what the last pixel sees."""
    radius, most = 0.15, 80.0 * DEG
    known = Depths(np.zeros(5), np.eye(5), np.zeros((5, 5)))
    pixels = Pixels(np.array([[1.0, 0.3, 0.0], [1.0, 0.3, 1.0]]), np.zeros(2, np.int64), np.full(2, 0.5))
    view = EndView(known, COLUMN_MM * np.arange(6.0), LEAN, COLUMN_MM, end_phases(False), 0.0, 0.0, pixels)
    of = np.arange(2)
    both = np.ones(2)
    depth, _, past = rendered_end(view, radius * both, 0.0 * both, most * both, of, 0.0 * both)
    turn_at = np.linspace(0.0, most - LEAN, 20_001)
    place = radius * (np.sin(turn_at) - (1.0 - np.cos(turn_at)) * np.tan(LEAN))
    light = np.cos(LEAN + turn_at) / np.cos(LEAN)
    within = place >= place[-1] - (0.5 * COLUMN_MM - past[1])
    assert np.trapezoid(light[within], place[within]) == pytest.approx(0.3 * COLUMN_MM, rel=1e-2)
    assert past[1] < past[0]
    assert depth[1, 1] < depth[0, 1]


@pytest.mark.parametrize("offset_mm", [-0.004, 0.003, 0.005])
def test_a_small_offset_of_the_last_returns_proves_no_rounding(offset_mm: float) -> None:
    """As a thin burr along the edge has it: it was read as a rounding of 1 mm that the view hides nearly all of."""
    edges = 0.018 * end_groups(110.0)
    depth = np.where(np.arange(edges.size - 1) < 9, offset_mm, 0.0)
    known = Depths(depth, 0.0005**2 * np.eye(depth.size), free_depths(edges))
    phases = end_phases(False)
    view = EndView(known, edges, 48.0 * DEG, 0.018, phases, 0.0, 0.0, possible_pixels(len(phases)))
    templates = end_templates(PRIORS["unknown"])
    log = templates.log_prior[:, None] + together_log([seen_end(view, templates)])
    assert shares(log.ravel()).reshape(log.shape).sum(axis=1)[templates.size_mm > 0.3].sum() < 0.02
