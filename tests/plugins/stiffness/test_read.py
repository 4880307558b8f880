"""`stiffness.read`: a file's stiffness, or given numbers; nothing that is no stiffness."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError, PipelineError
from workbench.plugins.stiffness import read
from workbench.plugins.stiffness.read import stiffness_document
from workbench.plugins.stiffness.values import JointStiffness
from workbench.robot import Cell

from .conftest import K


def test_stiffness_is_the_cells_or_nobodys(cell: Cell) -> None:
    """No other robot's numbers stand in: the shipped cell states the paper's Table 2."""
    assert read(cell).nm_per_rad.tolist() == K.tolist()
    assert read() is None
    with pytest.raises(InputError, match=r"\$\.robot\.joint_stiffness_nm_per_rad: expected the joint stiffness"):
        read(dataclasses.replace(cell, joint_stiffness_nm_per_rad=None))
    assert read(joint_stiffness_nm_per_rad=[1e6] * 6).nm_per_rad.tolist() == [1e6] * 6


def test_a_file_comes_back(tmp_path: Path) -> None:
    covariance = np.diag((0.02 * K) ** 2)
    covariance[0, 1] = covariance[1, 0] = 0.3 * (0.02**2) * K[0] * K[1]
    document = stiffness_document(JointStiffness(K, covariance, 12.5, 3, 40))
    (tmp_path / "stiffness.json").write_bytes(document.content)
    found = read(stiffness=tmp_path / "stiffness.json")
    assert np.array_equal(found.nm_per_rad, K)
    assert np.array_equal(found.covariance, covariance)
    assert (found.condition_number, found.postures, found.loads) == (12.5, 3, 40)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_stiffness_nm_per_rad": [1e6, 0, 1e6, 1e6, 1e6, 1e6]}, "[1]: expected greater than 0, got 0"),
        ({"joint_stiffness_nm_per_rad": [1e6, 1e6, 1e6, 1e6, 1e6, -3]}, "[5]: expected greater than 0, got -3"),
        ({"joint_stiffness_nm_per_rad": [1e6] * 5}, "expected 6 entries, found 5"),
        ({"joint_stiffness_nm_per_rad": "soft"}, "expected a valid array"),
        ({"covariance": [[1.0] * 6] * 5}, "expected 6 entries, found 5"),
        ({"covariance": (-np.eye(6)).tolist()}, "positive semi-definite"),
        ({"covariance": (np.eye(6) + np.eye(6, k=1)).tolist()}, "symmetric"),
        ({"covariance": None}, "expected a valid array"),
    ],
)
def test_what_is_no_stiffness_is_refused(tmp_path: Path, change: Any, message: str) -> None:
    good = {"joint_stiffness_nm_per_rad": K.tolist(), "covariance": np.eye(6).tolist()}
    (tmp_path / "stiffness.json").write_text(json.dumps(good | change))
    with pytest.raises(InputError) as caught:
        read(stiffness=tmp_path / "stiffness.json")
    assert message in str(caught.value)


def test_numbers_given_are_checked() -> None:
    with pytest.raises(PipelineError, match="greater than 0"):
        read(joint_stiffness_nm_per_rad=(1e6, 1e6, 0, 1e6, 1e6, 1e6))
