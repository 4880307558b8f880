"""The mapping file: strict, every mistake with its place and the nearest known name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.importing.conftest import MAPPING, poses_part, profiles_part
from workbench.errors import InputError
from workbench.importing.mapping import read_mapping

CASES: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": ({"profile": {}}, r"\$\.profile: unknown key; did you mean 'profiles'"),
    "unknown key inside": (
        {"profiles": profiles_part(delimeter=";")}, r"\$\.profiles\.delimeter: unknown key; did you mean 'delimiter'",
    ),
    "unknown key of columns": (
        {"profiles": profiles_part(columns={"x": "x", "zz": "z"})}, r"\$\.profiles\.columns\.zz: unknown key",
    ),
    "no version": ({"version": None}, r"\$\.version"),
    "unit": ({"poses": poses_part(length_unit="km")}, r"\$\.poses\.length_unit: expected 'mm', 'm'"),
    "convention": ({"poses": poses_part(convention="fanuc")}, r"unknown convention 'fanuc'; did you mean 'fanuc_wpr'"),
    "three of four": ({"poses": poses_part(orientation=["a", "b", "c"])}, r"expected 4 orientation columns"),
    "no angle unit": (
        {"poses": poses_part("euler_zyz_intrinsic", angle_unit=None)}, r"expected angle_unit for euler_zyz_intrinsic",
    ),
    "an angle unit for nothing": ({"poses": poses_part(angle_unit="deg")}, r"expected no angle_unit"),
    "no time unit": ({"poses": poses_part(time_unit=None)}, r"expected time_unit with time"),
    "comma twice": ({"profiles": profiles_part(decimal=",")}, r"expected a delimiter that is not the decimal mark"),
    "no frame column": (
        {"profiles": profiles_part(columns={"x": "x", "z": "z", "time": "t"})}, r"expected columns.frame",
    ),
    "rows with columns": ({"profiles": profiles_part(frames="rows")}, r"expected x_first, x_pitch"),
    "rate without rate": ({"times": {"source": "rate"}}, r"expected rate_hz with source 'rate'"),
    "offset of a rate": (
        {"times": {"source": "pose_each", "clock_offset_s": 0.1}}, r"expected clock_offset_s with source 'file' only",
    ),
    "two hand-eyes": ({"hand_eye": {}}, r"expected one of flange_from_profiler, file"),
    "accept": ({"accept": ["all"]}, r"\$\.accept\[0\]: expected 'length_unit'"),
    "base_dir": ({"base_dir": "/"}, r"\$\.base_dir: unknown key"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_mistakes(case: str, tmp_path: Path) -> None:
    changes, message = CASES[case]
    path = tmp_path / "map.json"
    path.write_text(json.dumps({**MAPPING, **changes}))
    with pytest.raises(InputError, match=message) as caught:
        read_mapping(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_whole_mapping(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_text(json.dumps({**MAPPING, "profiles": profiles_part(), "poses": poses_part("ur")}))
    mapping = read_mapping(path)
    assert mapping.base_dir == tmp_path
    assert mapping.poses is not None
    assert mapping.poses.convention == "ur"


@pytest.mark.parametrize("text", ["", "[]", "{", '{"version": NaN}', '{"version": 1, "version": 1}', "\xff"])
def test_no_json(text: str, tmp_path: Path) -> None:
    (tmp_path / "map.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"map\.json"):
        read_mapping(tmp_path / "map.json")
