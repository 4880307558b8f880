"""A rigid motion of the recording moves positions, turns directions and leaves sizes, through every stage."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.recordings import frames
from tests.contracts.conftest import DATA, moved_file, run_chain, values
from workbench.artefacts import u_name
from workbench.scan import read, write

POSITIONS = {"position_mm", "origin_mm", "robot_position_mm"}
DIRECTIONS = {"tangent", "normal", "across", "frame_tangent"}
POSES = {"base_from_profiler"}
EXEMPT = {
    *("source", "sha256"),  # the file's name and bytes
    "robot_quaternion_wxyz",  # q and -q are equal
    *("reference", "tilt", "root_angle", "bevel_angle"),  # angles in the section plane from an arbitrary direction
}
TOLERANCE = 1e-5  # mm, rad, deg: float32 profiles and float64 poses allow no more than rounding


def test_sizes_stay_and_positions_move(chain: Any, moved_chain: Any, motion: Any) -> None:
    rows = zip(values(chain.results.artefacts), values(moved_chain.results.artefacts), strict=True)
    compared = {place: expectation(place, here, motion) for (place, here), _ in rows}
    there = dict(values(moved_chain.results.artefacts))
    assert {place.rsplit(".", 1)[-1] for place in compared} >= {
        "position_mm",
        "origin_mm",
        "tangent",
        "base_from_profiler",
        "root_mm",
    }
    wrong = [place for place, expected in compared.items() if not same(expected, there[place], place)]
    assert wrong == []


@pytest.mark.parametrize(("pipeline", "file"), [("inspect_groove", "groove"), ("inspect_preparation", "milled_nose")])
def test_sections_of_joints_move_with_the_part(pipeline: str, file: str, tmp_path: Path, motion: Any) -> None:
    """Values to a tenth of their u: which returns are outliers may turn on a last digit."""
    stage = pipeline.replace("_", ".")
    whole = read(recording=DATA / f"{file}.h5")
    recording = frames(whole, np.arange(len(whole.time_s) // 2))
    write(recording, tmp_path / "here.h5")
    here, there = (
        run_chain(pipeline, stage, recording=one).results[stage]
        for one in (tmp_path / "here.h5", moved_file(recording, tmp_path))
    )
    assert len(here.sections) == len(there.sections) > 5
    for one, other in zip(here.sections, there.sections, strict=True):
        for name in ("origin_mm", "tangent", "normal", "across"):
            np.testing.assert_allclose(getattr(other, name), expectation(name, getattr(one, name), motion), atol=1e-4)
        told = [size for size in one.values if one.values.get(u_name(size)) is not None]
        assert len(told) > 3
        for size in told:
            assert abs(other.values[size] - one.values[size]) < 0.1 * one.values[u_name(size)]


def test_a_moved_plan_is_the_same_plan(plan_chains: Any, motion: Any) -> None:
    """Points move with the part, cutter axes turn with it; heights, feeds and what is cut stay."""
    here, there = (chain.results["path.feed"] for chain in plan_chains)
    assert len(here.layers) == len(there.layers) > 2
    for one, other in zip(here.layers, there.layers, strict=True):
        np.testing.assert_allclose(other.position_mm, expectation("position_mm", one.position_mm, motion), atol=1e-4)
        turned = Rotation.from_matrix(motion[:3, :3]) * Rotation.from_quat(one.quaternion_wxyz, scalar_first=True)
        apart = turned.inv() * Rotation.from_quat(other.quaternion_wxyz, scalar_first=True)
        assert apart.magnitude().max() < 1e-5
        np.testing.assert_allclose(other.arc_length_mm, one.arc_length_mm, atol=1e-4)
        np.testing.assert_allclose(other.width_mm, one.width_mm, atol=1e-4)
        np.testing.assert_array_equal(other.cutting, one.cutting)
        np.testing.assert_allclose(other.feed_mm_s, one.feed_mm_s, rtol=1e-3)


def expectation(place: str, value: Any, motion: Any) -> Any:
    """What a value becomes when the recording is moved."""
    name = place.rsplit(".", 1)[-1]
    if name in POSITIONS:
        return value @ motion[:3, :3].T + motion[:3, 3]
    if name in DIRECTIONS:
        return value @ motion[:3, :3].T
    if isinstance(value, bytes) and b'"edge-line"' in value:
        document = json.loads(value)
        points, side = (np.array(document[key]) @ motion[:3, :3].T for key in ("points_mm", "upper_side"))
        document |= {"points_mm": (points + motion[:3, 3]).tolist(), "upper_side": side.tolist()}
        return json.dumps(document, indent=1).encode() + b"\n"
    return motion @ value if name in POSES else value


def same(expected: Any, got: Any, place: str) -> bool:
    if place.rsplit(".", 1)[-1] in EXEMPT or ".checks." in place:  # the reach from the robot's base is one of them
        return True
    if isinstance(expected, bytes):
        (said, numbers), (other, found) = spoken(expected), spoken(got)
        return said == other and bool(np.allclose(numbers, found, rtol=1e-6, atol=TOLERANCE))
    if isinstance(expected, float | np.ndarray) and np.asarray(expected).dtype.kind == "f":
        return bool(np.allclose(expected, got, rtol=1e-6, atol=TOLERANCE, equal_nan=True))
    return bool(np.array_equal(expected, got))


def spoken(document: bytes) -> tuple[list[bytes], list[float]]:
    """Words and decimals of a document, but for its own numbers (of all digits), the file's name and its places."""
    own = rb"<(\w*QPId)>[^<]*</\1>|<AttributeStr name=\"(?:origin in the base mm|input recording)\"[^>]*>"
    parts = re.split(rb"(-?\d+\.\d+(?:e-?\d+)?)", re.sub(own, b"", document))
    return parts[::2], [float(number) for number in parts[1::2]]
