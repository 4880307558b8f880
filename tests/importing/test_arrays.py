"""Arrays by name: what does not fit together is refused by name; without times the frames go by way or by number."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.importing.test_draft import drafted
from workbench.artefacts import Recording
from workbench.cli import main
from workbench.errors import InputError

N, M = 25, 40
WAY_MM = np.linspace(0.0, 48.0, N)
SCAN = {"x": np.linspace(-20.0, 20.0, M), "z": np.tile(np.linspace(80.0, 90.0, M), (N, 1))}
POSES = {
    "position": np.column_stack([np.full(N, 900.0), WAY_MM, np.full(N, 500.0)]),
    "quaternion_wxyz": np.tile([1.0, 0.0, 0.0, 0.0], (N, 1)),
    "pose_time": np.linspace(10.0, 12.4, N),
}
TWICE = np.tile(np.diag([2.0, 2.0, 2.0, 1.0]), (N, 1, 1))


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"z": SCAN["z"]}, "expected an array x too"),
        ({**SCAN, "x": np.zeros(M + 1)}, f"expected x like z, found shapes ({M + 1},) and ({N}, {M})"),
        ({**SCAN, "time": np.arange(N - 1.0)}, f"expected time of {N} frames, found shape ({N - 1},)"),
        ({**SCAN, "travel": np.arange(N - 1.0)}, f"expected travel of {N} frames"),
        ({"base_from_flange": TWICE}, "pose 1: expected a rigid motion"),
        ({"position": POSES["position"]}, "quaternion_wxyz (K, 4), w first"),
        ({**POSES, "position": POSES["position"] * np.nan}, "expected finite positions"),
        ({**POSES, "pose_time": np.arange(N - 1.0)}, f"expected a time a pose, found shape ({N - 1},)"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_name(arrays: Any, words: str, tmp_path: Path, capsys: Any) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    mapping = {"format": "import-mapping", "version": 1, "arrays": {"length_unit": "mm", "time_unit": "s"}}
    (tmp_path / "map.json").write_text(json.dumps(mapping))
    arguments = [str(tmp_path / "a.npz"), "--mapping", str(tmp_path / "map.json"), "--out", str(tmp_path / "a.h5")]
    assert main(["import", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "a.h5").exists()


def test_an_array_stands_for_one_thing(tmp_path: Path, imported: Any, mapped: Any) -> None:
    np.savez(tmp_path / "a.npz", **SCAN)
    with pytest.raises(InputError, match="for 'x' and 'z', the mapping names one for both"):
        imported(tmp_path / "a.npz", mapping=mapped(arrays={"x": "z"}))


@pytest.mark.parametrize("source", ["travel", "travel that falls", "rate"])
def test_frames_without_times_go_by_the_way_or_evenly(
    source: str, tmp_path: Path, capsys: Any, imported: Callable[..., Recording]
) -> None:
    """Every second frame: by travel each lies where the flange had gone as far, by rate they fill the poses' time."""
    from_mm, sign = (90.0, -1.0) if source == "travel that falls" else (0.0, 1.0)
    some = {} if source == "rate" else {"travel": from_mm + sign * WAY_MM[4:21:2]}
    np.savez(tmp_path / "scan.npz", x=SCAN["x"], z=SCAN["z"][4:21:2], **some)
    np.savez(tmp_path / "poses.npz", **POSES)
    tree, _ = drafted(tmp_path, capsys, tmp_path / "scan.npz", tmp_path / "poses.npz")
    assert tree["times"]["source"] == source.partition(" ")[0]
    assert any(text.startswith("times.") for text in tree["uncertain"])
    if some:
        tree["times"]["start_mm"] = from_mm  # the draft takes the first frame to be at the first pose
        (tmp_path / "map.json").write_text(json.dumps(tree))
    got = imported(tmp_path / "scan.npz", tmp_path / "poses.npz", mapping=tmp_path / "map.json")
    expected = POSES["pose_time"][4:21:2] if some else np.linspace(10.0, 12.4, 9)
    at = np.interp(got.time_s, got.robot_time_s, got.robot_position_mm[:, 1])
    np.testing.assert_allclose(at, np.interp(expected, POSES["pose_time"], WAY_MM), atol=1e-6)
