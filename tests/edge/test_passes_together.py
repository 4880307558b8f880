"""What passes say together of an edge that they see broken off by different shares."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.edge.broken_end import BrokenEnd
from workbench.edge.end_templates import SeenEnd


def views_together(radius_mm: float, begin_mm: tuple[float, ...], corners: int) -> BrokenEnd:
    """What ends of passes over 80 mm from there on say together: they stop 0.5 (the first) or 0.2 of the radius before.

    So many frames of the second pass show the edge.
    """
    radii = np.linspace(0.0, 0.4, 81)[:, None]  # under one incidence
    share, s = (
        np.full(radii.shape, 1.0 / radii.size),
        np.concatenate([at + np.linspace(0.0, 80.0, 200) for at in begin_mm]),
    )
    which = np.repeat(np.arange(len(begin_mm)), 200)
    hidden = np.where(which == 0, 0.5, 0.2)
    corner = (which == 1) & (np.arange(s.size) < 200 + corners)
    end_mm = 1.5 - np.where(corner, 0.0, hidden) * radius_mm + np.random.default_rng(3).normal(0.0, 0.005, s.size)
    none, u, lean = np.zeros(radii.shape), np.full(radii.shape, 0.002), (0.7, 0.3, 0.3)
    flat = none[..., None]
    seen = {p: SeenEnd(none, (0.2 if p else 0.5) * radii, u, flat, flat, lean[p]) for p in range(len(begin_mm))}
    beyond, u = (np.where(corner, 0.0, of * hidden) for of in (radii.mean(), radii.std()))
    found = BrokenEnd(beyond, u, np.zeros(s.size), 0.1, 0.0, u, share, seen, np.zeros(s.size))
    return found.agreed(s, end_mm, which, corner)


@pytest.mark.parametrize("of_corner", [False, True])
@pytest.mark.parametrize("radius_mm", [0.05, 0.3])
def test_places_at_which_passes_end_tell_the_rounding(radius_mm: float, of_corner: bool) -> None:
    found = views_together(radius_mm, (0.0, 0.0), 200 * of_corner)
    for number, short in enumerate((0.5, 0.0 if of_corner else 0.2)):
        beyond, u = found.beyond_mm[200 * number], found.together_u_mm[200 * number]
        assert abs(beyond - short * radius_mm) < 2.0 * u + 0.002
    assert found.together_u_mm.max() < (0.003 if of_corner else 0.015)  # of one pass alone 0.06


@pytest.mark.parametrize(
    ("begin_mm", "corners"), [((0.0, 0.0, 90.0), 0), ((0.0, 0.0), 1), ((0.0, 0.0), 20), ((0.0, 60.0, 120.0), 0)]
)
def test_a_view_of_another_part_of_the_edge_takes_nothing_from_what_others_tell(
    begin_mm: tuple[float, ...], corners: int
) -> None:
    found = views_together(0.3, begin_mm, corners)
    for number in range(len(begin_mm)):
        last = 200 * number + 199
        assert abs(found.beyond_mm[last] - (0.06 if number else 0.15)) < 0.01
        assert found.together_u_mm[last] < 0.015
