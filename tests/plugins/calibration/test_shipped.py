"""The shipped pipeline on the shipped recording, against its truth."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from workbench.cli import main
from workbench.synthetic import SphereRecipe

ROOT = Path(__file__).parents[3]
TABLE = ROOT / "docs" / "tables" / "sphere_recipe.csv"


def test_hand_eye_pose_is_the_true_one_within_its_uncertainty(tmp_path):
    assert main(["run", str(ROOT / "pipelines" / "calibrate_handeye.json"), "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "handeye.json").read_text())
    truth = json.loads((ROOT / "data" / "synthetic" / "sphere.truth.json").read_text())
    pose, true = (np.array(d["flange_from_profiler"]) for d in (found, truth))
    turn = Rotation.from_matrix(true[:3, :3] @ pose[:3, :3].T).as_rotvec()
    off = np.concatenate([true[:3, 3] - pose[:3, 3], turn])
    assert off @ np.linalg.solve(np.array(found["covariance"]), off) < chi2.ppf(0.999, 6)
    assert found["sphere_center_mm"] == pytest.approx(truth["sphere_center_mm"], abs=0.3)
    assert found["sphere_diameter_mm"] == pytest.approx(10, abs=0.03)
    assert found["warnings"] == []
    assert len(found["frames_used"]) == 36
    assert "Proposed further postures" in (tmp_path / "report.html").read_text()
    assert (tmp_path / "calibration_plan.csv").read_text().count("\n") == 4


def test_every_key_of_a_recipe_is_documented():
    words = re.findall(r"\w+", TABLE.read_text(encoding="utf-8"))
    schema = SphereRecipe.model_json_schema()
    parts = [schema, *(part for name, part in schema["$defs"].items() if name in ("SpherePass", "SphereRobot"))]
    assert len(parts) == 3
    assert [name for part in parts for name in part["properties"] if name not in words] == []
