"""The mapping file: strict, every mistake with its place and the nearest known name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.importing.conftest import MAPPING, poses_part, profiles_part
from workbench.errors import InputError
from workbench.importing.mapping import read_mapping

CASES: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": ({"profile": {}}, r"\$\.profile: unknown key; did you mean 'profiles'"),
    "unknown key inside": (
        {"profiles": profiles_part(delimeter=";")},
        r"\$\.profiles\.delimeter: unknown key; did you mean 'delimiter'",
    ),
    "unknown key of columns": (
        {"profiles": profiles_part(columns={"x": "x", "zz": "z"})},
        r"\$\.profiles\.columns\.zz: unknown key",
    ),
    "no version": ({"version": None}, r"\$\.version"),
    "unit": ({"poses": poses_part(length_unit="km")}, r"\$\.poses\.length_unit: expected 'mm', 'm'"),
    "convention": ({"poses": poses_part(convention="fanuc")}, r"unknown convention 'fanuc'; did you mean 'fanuc_wpr'"),
    "three of four": ({"poses": poses_part(orientation=["a", "b", "c"])}, r"expected 4 orientation columns"),
    "no angle unit": (
        {"poses": poses_part("euler_zyz_intrinsic", angle_unit=None)},
        r"expected angle_unit for euler_zyz_intrinsic",
    ),
    "an angle unit for nothing": ({"poses": poses_part(angle_unit="deg")}, r"expected no angle_unit"),
    "no time unit": ({"poses": poses_part(time_unit=None)}, r"expected time_unit with time"),
    "comma twice": ({"profiles": profiles_part(decimal=",")}, r"expected a delimiter that is not the decimal mark"),
    "no frame column": (
        {"profiles": profiles_part(columns={"x": "x", "z": "z", "time": "t"})},
        r"expected columns.frame",
    ),
    "rows with columns": ({"profiles": profiles_part(frames="rows")}, r"expected x_first, x_pitch"),
    "rate without rate": ({"times": {"source": "rate"}}, r"expected rate_hz with source 'rate'"),
    "offset of a rate": (
        {"times": {"source": "pose_each", "clock_offset_s": 0.1}},
        r"expected clock_offset_s with source 'file' only",
    ),
    "two hand-eyes": ({"hand_eye": {}}, r"expected one of flange_from_profiler, file, position"),
    "accept": ({"accept": ["all"]}, r"\$\.accept\[0\]: expected 'length_unit'"),
    "a date": ({"recorded_at": "31.03.2026"}, r"map\.json: line 1: \$: recorded_at: expected a date as 2026-03-31"),
    "base_dir": ({"base_dir": "/"}, r"\$\.base_dir: unknown key"),
}


@pytest.mark.parametrize("case", CASES)
def test_mistakes(case: str, tmp_path: Path) -> None:
    changes, message = CASES[case]
    path = tmp_path / "map.json"
    path.write_text(json.dumps({**MAPPING, **changes}))
    with pytest.raises(InputError, match=message) as caught:
        read_mapping(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"version": NaN}', '{"version": 1, "version": 1}', "\xff"])
def test_no_json(text: str, tmp_path: Path) -> None:
    (tmp_path / "map.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"map\.json"):
        read_mapping(tmp_path / "map.json")


def test_all_problems_at_once_each_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_text("""{"format": "import-mapping", "version": 1,
      "profiles": {"delimeter": ";",
        "frames": "colum", "columns": {"x": "a", "zz": 3}},
      "poses": {"position": ["X", "Y"],
        "orientation": ["A", "B", "C"], "convention": "kuka"},
      "times": {"source": "rate"}}""")
    with pytest.raises(InputError) as caught:
        read_mapping(path)
    text = str(caught.value)
    for line, problem in [
        (2, r"$.profiles.delimeter: unknown key; did you mean 'delimiter'"),
        (2, r"$.profiles.length_unit: is required"),
        (3, r"$.profiles.columns.zz: unknown key"),
        (3, r"$.profiles.frames: expected 'column'"),
        (4, r"$.poses.position[2]: is required"),
        (6, r"$.times: expected rate_hz"),
    ]:
        assert f"line {line}: {problem}" in text
    assert "\n" not in text


TURN = Rotation.from_rotvec([0.3, -1.2, 2.0])
CONTROLLERS = {  # (numbers as a teach pendant shows them, the rotation by scipy)
    "abb_xyz": ([30.0, -20.0, 75.0], Rotation.from_euler("xyz", [30.0, -20.0, 75.0], degrees=True)),
    "fanuc_wpr": ([30.0, -20.0, 75.0], Rotation.from_euler("xyz", [30.0, -20.0, 75.0], degrees=True)),
    "yaskawa_rxyz": ([30.0, -20.0, 75.0], Rotation.from_euler("xyz", [30.0, -20.0, 75.0], degrees=True)),
    "kuka_abc": ([75.0, -20.0, 30.0], Rotation.from_euler("ZYX", [75.0, -20.0, 30.0], degrees=True)),
    "staubli_rxyz": ([30.0, -20.0, 75.0], Rotation.from_euler("XYZ", [30.0, -20.0, 75.0], degrees=True)),
    "ur": ([0.3, -1.2, 2.0], TURN),
    "abb": (np.roll(TURN.as_quat(), 1).tolist(), TURN),
}


@pytest.mark.parametrize("convention", CONTROLLERS)
def test_hand_eye_as_a_teach_pendant_shows_it(convention: str, tmp_path: Path) -> None:
    numbers, turn = CONTROLLERS[convention]
    path = tmp_path / "map.json"
    for position, unit in (([10, 20, 30], "mm"), ([0.01, 0.02, 0.03], "m")):
        eye = {"position": position, "length_unit": unit, "orientation": numbers, "convention": convention}
        path.write_text(json.dumps({**MAPPING, "hand_eye": eye}))
        hand_eye = read_mapping(path).hand_eye
        assert hand_eye is not None
        np.testing.assert_allclose(hand_eye.pose()[:3, :3], turn.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(hand_eye.pose()[:3, 3], [10, 20, 30])


@pytest.mark.parametrize(
    ("eye", "says"),
    [
        ({"position": [1, 2, 3]}, "position, orientation and convention together"),
        ({"position": [1, 2, 3], "orientation": [1, 2, 3], "convention": "kuka"}, "did you mean 'kuka_abc'"),
        ({"position": [1, 2, 3], "orientation": [9, 2, 3], "convention": "ur"}, "degrees declared as rad"),
        ({"position": [1, 2, 3], "orientation": [1, 1, 0, 0], "convention": "abb"}, "norm 1"),
    ],
)
def test_hand_eyes_that_are_none(eye: dict[str, Any], says: str, tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_text(json.dumps({**MAPPING, "hand_eye": eye}))
    with pytest.raises(InputError, match=says):
        read_mapping(path)
