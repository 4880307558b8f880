"""Laws of the predicted information."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from workbench.edge.broken_end import ALIKE_MM
from workbench.edge.column_errors import Linearity
from workbench.scan_plan.information import Joint, Knowledge, Predicted, Profiler, View, combined, information
from workbench.scan_plan.rehearsal import _farther_mm
from workbench.units import DEG

JOINT = Joint(8.0, 1.5, 40.0 * DEG)
SENSOR = Profiler(800, (120.0, 190.0), (28.0, 28.0), 0.01, 1.0, Linearity(0.001, 6.0))
SHARP = Knowledge(edge_condition="sharp")
LENGTH_MM = 80.0
UNHARMED = 1.1  # INTERFACES: what adds information never raises u by more than a tenth


def told(*elevations_deg: float, sensor: Profiler = SENSOR, known: Knowledge = SHARP, pitch: float = 0.4) -> Predicted:
    views = [View(one * DEG, 150.0, pitch) for one in elevations_deg]
    passes = [information(JOINT, sensor, known, view, LENGTH_MM) for view in views]
    return combined(JOINT, known, [one for one in passes if one is not None], LENGTH_MM)


def no_worse(better: Predicted, worse: Predicted) -> bool:
    """Passes whose view of the break differs by less than ALIKE_MM count alike to the engine (`broken_end.weights`)."""
    alike = {"root_mm": ALIKE_MM / 3.0, "bevel_deg": 0.0}
    return all(getattr(better, n) <= UNHARMED * getattr(worse, n) + a for n, a in alike.items())


@pytest.mark.parametrize(("first", "second"), [(40.0, 40.0), (50.0, 10.0), (20.0, -30.0), (-30.0, 50.0), (0.0, 30.0)])
def test_a_further_pass_never_raises_u(first: float, second: float) -> None:
    assert no_worse(told(first, second), told(first))
    assert no_worse(told(first, second), told(second))


@pytest.mark.parametrize("elevation", [45.0, 10.0, -30.0])
@pytest.mark.parametrize(
    "finer",
    [
        {"sensor": dataclasses.replace(SENSOR, columns=1600)},
        {"sensor": dataclasses.replace(SENSOR, noise_mm=0.005)},
        {"sensor": dataclasses.replace(SENSOR, linearity=Linearity(0.0, 6.0))},
        {"pitch": 0.2},
    ],
    ids=["columns", "noise", "linearity", "frames"],
)
def test_what_is_finer_never_raises_u(elevation: float, finer: dict[str, object]) -> None:
    assert no_worse(told(elevation, **finer), told(elevation))  # type: ignore[arg-type]


def test_order_of_passes_and_side_of_the_lead_change_nothing() -> None:
    one, other = told(45.0, -30.0), told(-30.0, 45.0)
    assert one.root_mm == pytest.approx(other.root_mm)
    assert one.bevel_deg == pytest.approx(other.bevel_deg)
    leads = [
        information(JOINT, SENSOR, SHARP, View(30.0 * DEG, 150.0, 0.4, lead * DEG), LENGTH_MM) for lead in (10, -10)
    ]
    u = [combined(JOINT, SHARP, [one], LENGTH_MM).bevel_deg for one in leads if one is not None]
    assert u[0] == pytest.approx(u[1])


def test_a_view_that_shows_the_lower_edge_leaves_no_rounding_open() -> None:
    unknown = Knowledge(edge_condition="unknown")
    above, square, below = (told(one, known=unknown).root_mm for one in (50.0, 10.0, -30.0))
    assert below < 0.7 * square < 0.35 * above
    assert told(50.0, -30.0, known=unknown).root_mm < 2.0 * below


def test_u_scales_with_the_declared_linearity() -> None:
    some, more = (
        told(20.0, sensor=dataclasses.replace(SENSOR, linearity=Linearity(rms, 6.0))).bevel_deg for rms in (0.01, 0.02)
    )
    assert more == pytest.approx(2.0 * some, rel=0.1)


@pytest.mark.parametrize("view", [View(85.0 * DEG, 150.0, 0.4), View(30.0 * DEG, 121.0, 0.4)])
def test_what_cannot_be_seen_tells_nothing(view: View) -> None:
    assert information(JOINT, SENSOR, SHARP, view, LENGTH_MM) is None


@pytest.mark.parametrize("rise", [1e-13, -1e-13])
def test_a_ray_square_to_the_root_face_does_not_meet_the_lower_surface_by_rounding(rise: float) -> None:
    """With a lead, rounding gave such rays a rise: past the edge they returned from 4e8 m, and the plan was refused."""
    origin = np.stack([np.zeros(9), np.full(9, -50.0), np.linspace(-0.4, 0.4, 9)], axis=1)[None]
    pixel, lead = np.array([0.0, 0.0, 0.05]), 15.0 * DEG
    square, nearly = (
        _farther_mm(origin, pixel, np.array([math.sin(lead), math.cos(lead), up]), 0.2) for up in (0.0, rise)
    )
    np.testing.assert_allclose(nearly, square, atol=1e-6)
    assert 0.0 < np.nanmax(square) < 0.4
