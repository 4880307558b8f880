"""Identification: Table 2 comes back with honest uncertainty, what cannot be known is refused with the reason."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from workbench import Pipeline
from workbench.api import rotation_from_vector
from workbench.errors import InputError
from workbench.plugins.stiffness import identify
from workbench.plugins.stiffness.simulate_loads_stage import loads_csv, simulate_tests
from workbench.plugins.stiffness.values import LoadingTests
from workbench.robot import Cell

from .conftest import ROOT, K


@pytest.mark.parametrize("targets", [0, 3, 4])
def test_exact_loads_give_table_2_exactly(identified: Any, exact: Any, targets: int) -> None:
    found = identified(exact(targets))[0]
    assert np.abs(found.nm_per_rad / K - 1).max() < 1e-5


def as_built(tests: LoadingTests, seed: int) -> LoadingTests:
    """As a robot and a sensor give them that stand otherwise than stated by as much as is usual."""
    rng = np.random.default_rng([seed, 1])
    turn = rotation_from_vector(np.radians(0.5) * rng.normal(size=3))
    wrench = (tests.wrench.reshape(-1, 2, 3) @ turn).reshape(-1, 6) * np.r_[[1 + 0.01 * rng.normal()] * 3, 1, 1, 1]
    joints = tests.joints + np.radians(0.3) * rng.normal(size=6) * [0, 1, 1, 1, 1, 1]
    return dataclasses.replace(tests, wrench=wrench * (1 + 0.02 * rng.normal()), joints=joints)


def test_uncertainties_are_honest(identified: Any, noisy: Any) -> None:
    """6 trials: the 95 % ellipsoid holds, and is no larger than it must be; as built exactly: tests/metrology."""
    found = [identified(as_built(noisy(seed), seed))[0] for seed in range(6)]
    squares = [(one.nm_per_rad - K) @ np.linalg.solve(one.covariance, one.nm_per_rad - K) for one in found]
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 6)) > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / len(found))
    assert abs(np.mean(squares) / 6 - 1) < 5 / np.sqrt(3 * len(found))


def test_missing_points_are_no_loss_of_sense(identified: Any, noisy: Any) -> None:
    tests = noisy(3, 4)
    holes = tests.vectors.copy()
    holes[::3, 1] = np.nan
    holes[5, :3] = np.nan
    found = identified(dataclasses.replace(tests, moved=holes.reshape(tests.moved.shape)))[0]
    assert (np.abs(found.nm_per_rad - K) < 4 * found.u_nm_per_rad).all()
    whole = identified(tests)[0]
    assert (found.u_nm_per_rad / found.nm_per_rad > whole.u_nm_per_rad / whole.nm_per_rad).all()


def test_more_noise_than_stated_widens(identified: Any, cell: Cell, exact: Any) -> None:
    tests, rng = exact(), np.random.default_rng(6)
    noise = rng.normal(size=(72, 6)) * ([0.03] * 3 + [1.0e-4] * 3)
    found = identified(dataclasses.replace(tests, moved=tests.moved + noise))[0]
    assert any("times what the cell's noise predicts" in note for note in found.warnings)
    assert found.loads == 72
    assert (np.abs(found.nm_per_rad - K) < 4 * found.u_nm_per_rad).all()


def loads(cell: Cell, joints: Any, force: Any, points: Any, seed: int = 1) -> LoadingTests:
    """+- pairs of given forces (flange axes) at points of the flange."""
    setup = cell.loading
    rows = [
        (q, s * np.concatenate([f, np.cross(p - setup.flange_from_sensor[:3, 3], f) / 1e3]))
        for q in joints
        for f in force
        for p in points
        for s in (1, -1)
    ]
    q, w = (np.array(part) for part in zip(*rows, strict=True))
    return simulate_tests(cell.chain, setup, K, q, w, ("1",) * len(q), rng=np.random.default_rng(seed))


def in_base(cell: Cell, q: Any, force: Any) -> Any:
    from workbench.robot import forward_kinematics

    return forward_kinematics(cell.chain, q)[:3, :3].T @ np.array(force, float)


def test_in_line_tool_loses_joint_6(identified: Any, noisy: Any) -> None:
    with pytest.raises(InputError, match=r"joint 6 cannot be determined: every force acts through its axis"):
        identified(noisy(8, 0, 1))


@pytest.mark.parametrize(("force", "lost"), [([0, 0, 200], "joint 1 cannot"), ([0, 200, 0], "joints 2 and 3 cannot")])
def test_one_direction_loses_joints(identified: Any, cell: Cell, table_a1: Any, force: Any, lost: str) -> None:
    """Forces along the base's z do not turn joint 1; along y, at q1 = 0, neither joint 2 nor joint 3."""
    points = cell.loading.load_points_mm[1:]
    parts = [loads(cell, [q], [in_base(cell, q, force)], points, seed=i) for i, q in enumerate(table_a1)]
    tests = dataclasses.replace(
        parts[0],
        labels=("1",) * 18,
        lines=tuple(range(2, 20)),
        joints=np.vstack([p.joints for p in parts]),
        wrench=np.vstack([p.wrench for p in parts]),
        moved=np.vstack([p.moved for p in parts]),
    )
    with pytest.raises(InputError, match="all forces are parallel to its axis") as caught:
        identified(tests)
    assert lost in str(caught.value)


def test_pipeline_writes_the_contract(tmp_path: Path) -> None:
    """The shipped pipeline on the shipped loads."""
    results = Pipeline.load(ROOT / "pipelines" / "identify_stiffness.json").run(tmp_path / "out")
    document = json.loads((tmp_path / "out" / "stiffness.json").read_text())
    assert document["postures"] == 3
    assert document["loads"] == 120
    k, covariance = np.array(document["joint_stiffness_nm_per_rad"]), np.array(document["covariance"])
    assert (k - K) @ np.linalg.solve(covariance, k - K) < chi2.ppf(0.999, 6)
    assert document["condition_number"] > 1
    assert results.warnings == []


def test_file_and_dh_angles(identified: Any, cell: Cell, noisy: Any, tmp_path: Path) -> None:
    """A file written and read gives what the tests in memory give; DH angles with their convention too."""
    path = tmp_path / "loads.csv"
    tests = noisy(9, 4)
    path.write_bytes(loads_csv(tests, "a comment"))
    from_file = identify(cell, loads=path)[0]
    assert np.allclose(from_file.nm_per_rad, identified(tests)[0].nm_per_rad, rtol=1e-4)
    back = tests.joints * [1, -1, -1, 1, -1, 1] + np.radians([0, 90, 0, 0, 0, -180])
    path.write_bytes(loads_csv(dataclasses.replace(tests, joints=back)))
    assert np.allclose(identify(cell, loads=path, angle_convention="dh")[0].nm_per_rad, from_file.nm_per_rad, rtol=1e-4)
    with pytest.raises(InputError, match="Denavit-Hartenberg angles need angle_convention 'dh'"):
        identify(cell, loads=path)
    with pytest.raises(InputError, match="loading"):
        identify(dataclasses.replace(cell, loading=None), loads=path)
