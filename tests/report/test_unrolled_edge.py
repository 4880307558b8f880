"""The edge laid out straight: exact on a straight edge and on an arc, whatever the section's axes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from workbench.report.along import developed, in_section


def on_part(edge, s, u, v):
    """Base position of developed coordinates at station s (a whole number of mm)."""
    return edge.position_mm[s] + u * edge.normal[s] + v * edge.across[s]


@pytest.mark.parametrize("radius_mm", [None, 300.0])
def test_a_point_is_found_again(part, radius_mm):
    edge = part(radius_mm=radius_mm, frames=20, columns=20).edge
    truth = [(3, -1.0, 2.0), (40, 0.5, 0.0), (150, -7.0, 10.0)]
    position = np.array([on_part(edge, *each) for each in truth])
    start = np.array([s for s, _, _ in truth]) + 2.7  # an oblique laser plane starts 15 deg off
    np.testing.assert_allclose(developed(position, start, edge), truth, atol=2e-4)


def test_the_edge_runs_on_straight_beyond_its_ends(part):
    edge = part(frames=20, columns=20).edge
    position = edge.position_mm[:1] - 4.0 * edge.tangent[:1] + 2.0 * edge.normal[:1]
    np.testing.assert_allclose(developed(position, np.zeros(1), edge), [[-4.0, 2.0, 0.0]], atol=1e-9)


def test_a_section_has_its_own_axes_and_origin(part):
    p = part(radius_mm=500.0, frames=20, columns=20)
    section, turn = p.inspection.sections[2], 0.1
    n, m = section.normal, section.across
    turned = dataclasses.replace(
        section,
        normal=np.cos(turn) * n + np.sin(turn) * m,
        across=np.cos(turn) * m - np.sin(turn) * n,
        origin_mm=section.origin_mm + 0.3 * n,
    )
    position = turned.origin_mm + 1.2 * turned.normal + 3.4 * turned.across
    got = in_section(position[None], np.array([section.arc_length_mm]), p.edge, turned)
    np.testing.assert_allclose(got, [[1.2, 3.4]], atol=1e-3)
