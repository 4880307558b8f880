"""`handeye.json`: read strictly, or refused with the place in it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.api import pose_from, rotation_from_rpy
from workbench.errors import InputError
from workbench.scan import read_hand_eye
from workbench.units import DEG

POSE = pose_from(
    rotation_from_rpy(60.489 * DEG, -3.813 * DEG, -2.024 * DEG), np.array([126.92, 9.44, 41.48])
)  # the paper's
COVARIANCE = np.diag([1e-2, 1e-2, 4e-2, 1e-8, 1e-8, 4e-8])


def calibration(**changes: Any) -> dict[str, Any]:
    return {"flange_from_profiler": POSE.tolist(), "covariance": COVARIANCE.tolist(), "method": "m", **changes}


def written(tmp_path: Path, content: Any) -> Path:
    path = tmp_path / "handeye.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_calibration_is_read_with_its_covariance(tmp_path: Path) -> None:
    path = written(tmp_path, calibration())
    hand_eye = read_hand_eye(path)
    np.testing.assert_array_equal(hand_eye.flange_from_profiler, POSE)
    assert hand_eye.covariance is not None
    np.testing.assert_array_equal(hand_eye.covariance, COVARIANCE)
    assert hand_eye.source == str(path)


@pytest.mark.parametrize("content", [{"flange_from_profiler": np.eye(4).tolist()}, calibration(covariance=None)])
def test_the_covariance_may_be_absent_or_null(tmp_path: Path, content: dict[str, Any]) -> None:
    assert read_hand_eye(written(tmp_path, content)).covariance is None


def test_what_a_calibration_warns_of_goes_with_it(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=r"handeye\.json: a misfit"):
        read_hand_eye(written(tmp_path, calibration(warnings=["a misfit that repeatability cannot explain"])))


def test_translation_and_angles_may_be_rounded(tmp_path: Path) -> None:
    path = written(tmp_path, calibration(translation_mm=[126.9, 9.4, 41.5], rotation_rpy_deg=[60.49, -3.81, 357.98]))
    np.testing.assert_array_equal(read_hand_eye(path).flange_from_profiler, POSE)


def entry(matrix: Any, i: int, j: int, value: Any) -> list[list[Any]]:
    rows: list[list[Any]] = np.array(matrix).tolist()
    rows[i][j] = value
    return rows


BAD = {
    "not JSON": ('{"flange_from_profiler":\n [1,,]}', "line 2, column 5"),
    "NaN": (json.dumps(calibration(volume_u_mm=float("nan"))), "$.volume_u_mm: expected JSON: NaN is not JSON"),
    "binary": ("\x00\x01", "expected JSON"),
    "nested without end": ("[" * 200_000, "expected JSON"),
    "a key twice": ('{"method": 1, "method": 2}', "occurs twice"),
    "a list": ([1], "expected an object"),
    "no pose": ({"method": "m"}, "expected 'flange_from_profiler'"),
    "misspelt pose": (
        {"flange_from_profilr": POSE.tolist()},
        "expected 'flange_from_profiler', found 'flange_from_profilr'",
    ),
    "misspelt covariance": (calibration(covarience=[]), "did you mean 'covariance'"),
    "another translation": (calibration(translation_mm=[126.92, 9.44, 41.6]), "$.translation_mm: expected that of"),
    "angles in another order": (
        calibration(rotation_rpy_deg=[-2.024, -3.813, 60.489]),
        "$.rotation_rpy_deg: expected that of",
    ),
    "three rows": (
        calibration(flange_from_profiler=POSE[:3].tolist()),
        "profiler: expected 4 entries",
    ),
    "ragged": (
        calibration(flange_from_profiler=[*POSE[:3].tolist(), [0, 0, 1]]),
        "profiler[3]: expected 4 entries",
    ),
    "text": (calibration(flange_from_profiler=entry(POSE, 1, 2, "0.1")), "flange_from_profiler[1][2]"),
    "true": (calibration(flange_from_profiler=entry(POSE, 3, 3, True)), "flange_from_profiler[3][3]"),
    "null": (calibration(flange_from_profiler=entry(POSE, 0, 3, None)), "flange_from_profiler[0][3]"),
    "number beyond floats": (
        calibration(flange_from_profiler=entry(POSE, 0, 3, 10**400)),
        "flange_from_profiler[0][3]: expected JSON: expected a finite number",
    ),
    "mirrored": (calibration(flange_from_profiler=(POSE @ np.diag([1, 1, -1, 1])).tolist()), "rigid motion"),
    "sheared": (calibration(flange_from_profiler=entry(POSE, 0, 1, POSE[0, 1] + 1e-5)), "rigid motion"),
    "covariance 3 x 3": (calibration(covariance=np.eye(3).tolist()), "$.covariance[0]: expected 6 entries"),
    "covariance not symmetric": (calibration(covariance=entry(COVARIANCE, 0, 3, 5e-6)), "expected a covariance"),
    "negative variance": (calibration(covariance=entry(COVARIANCE, 5, 5, -1e-9)), "expected a covariance"),
}


@pytest.mark.parametrize(("content", "expected"), BAD.values(), ids=BAD)
def test_bad_calibrations_are_refused(tmp_path: Path, content: Any, expected: str) -> None:
    path = written(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_hand_eye(path)
    assert str(caught.value).startswith(str(path))
    assert expected in str(caught.value)


def test_a_missing_calibration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_hand_eye(tmp_path / "handeye.json")
