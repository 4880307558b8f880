"""Planned loading tests keep their promises: uncertainty, limits, collision, counts."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from workbench import Pipeline
from workbench.errors import InputError
from workbench.plugins.stiffness import identify, plan_loads, simulate_loads
from workbench.robot import Cell, CollisionModel

from .conftest import ROOT, K

DATA = ROOT / "data"


@pytest.fixture(scope="module")
def planned(cell: Cell, stiffness: Any) -> Any:
    return plan_loads(cell, stiffness, trials=80)[0]


def test_every_joint_within_5_percent_with_40_loads_a_posture(planned: Any) -> None:
    assert planned.noise_relative_u.max() <= 0.0255
    assert planned.warnings == ()
    counts = [planned.labels.count(label) for label in set(planned.labels)]
    assert len(counts) <= 3
    assert max(counts) <= 40


def test_postures_are_free_and_within_limits(cell: Cell, planned: Any) -> None:
    model = CollisionModel(cell)
    low, high = cell.chain.limits.T
    for q in np.unique(planned.joints, axis=0):
        assert ((low <= q) & (q <= high)).all()
        assert model.collision(q) is None


@pytest.mark.parametrize(("assumed", "scale", "targets"), [(0.0, 0.0, 0), (1.0, 0.02, 0), (2.0, 0.05, 4)])
def test_promise_is_kept(cell: Cell, stiffness: Any, tmp_path: Any, assumed: float, scale: float, targets: int) -> None:
    """Simulated, written, read and identified: the uncertainty stated is the promised one, the error within it."""
    held = {"as_built_u": assumed, "scale_relative_u": scale}
    plan, _ = plan_loads(cell, stiffness, trials=40, targets=targets, **held)
    path = tmp_path / "loads.csv"
    path.write_bytes(simulate_loads(plan, cell, stiffness, targets=targets, seed=3).content)
    found, *_ = identify(cell, loads=path, **held)
    assert np.allclose(found.u_nm_per_rad / found.nm_per_rad, plan.relative_u, rtol=0.1)
    assert (np.abs(found.nm_per_rad - K) < 4 * found.u_nm_per_rad).all()
    assert (plan.noise_relative_u <= plan.relative_u * 1.001).all()


def test_paper_postures_say_how_many_loads_are_missing(cell: Cell, stiffness: Any) -> None:
    postures = [(0, 93, -5, 45, 45, 45), (0, 113, -26, 45, 45, 45), (0, 88, -12, 45, 45, 45)]
    found, document = plan_loads(cell, stiffness, postures_deg=postures, angle_convention="dh", loads_per_posture=6)
    assert "needs some" in found.warnings[0]
    assert len(found.labels) == 18
    assert document.content.count(b"\n") == 20


def test_bad_postures_and_cells_are_refused(cell: Cell, stiffness: Any) -> None:
    with pytest.raises(InputError, match="joint 2 is beyond"):
        plan_loads(cell, stiffness, postures_deg=[(0, 93, -5, 45, 45, 45)])
    with pytest.raises(InputError, match="free of collision"):
        plan_loads(cell, stiffness, postures_deg=[(90, 80, 60, 0, 10, 0)])
    with pytest.raises(InputError, match="load_points_mm"):
        plan_loads(dataclasses.replace(cell, loading=None), stiffness)
    with pytest.raises(InputError, match="targets_mm"):
        plan_loads(cell, stiffness, targets=9)


def test_shipped_loads_are_what_the_pipeline_gives(tmp_path: Any) -> None:
    Pipeline.load(ROOT / "pipelines" / "plan_loads.json").run(tmp_path / "out")
    made, shipped = (
        np.loadtxt(path / "loads.csv", delimiter=",", skiprows=2) for path in (tmp_path / "out", DATA / "synthetic")
    )
    assert np.allclose(made[:, :7], shipped[:, :7], atol=1e-6)  # postures, deg
    assert np.allclose(made[:, 7:13], shipped[:, 7:13], atol=1e-3)
    assert np.allclose(made[:, 13:], shipped[:, 13:], atol=1e-5)
