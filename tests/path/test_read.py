"""A path comes back from its file as it was written; one that only holds what the contract asks for; bad ones."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made import files_of
from workbench.errors import InputError
from workbench.path import read

SHIPPED = Path(__file__).parents[2] / "data" / "synthetic" / "paths" / "raw_arc.json"
EVERY = ("arc_length_mm", "position_mm", "quaternion_wxyz", "feed_mm_s", "cutting", "measured", "width_mm")


@pytest.fixture
def document() -> dict[str, Any]:
    whole: dict[str, Any] = json.loads(SHIPPED.read_text())
    return whole


def written(folder: Path, document: Any) -> Path:
    (folder / "path.json").write_text(json.dumps(document))
    return folder / "path.json"


def test_a_path_comes_back_as_it_was_written(tmp_path: Path, document: dict[str, Any]) -> None:
    path = read(toolpath=SHIPPED)
    assert [layer.index for layer in path.layers] == [1, 2, 3, 4, 5]
    assert (path.root_mm, path.bevel_deg, path.depth_of_cut_mm, path.v_slow_mm_s) == (1.5, 40.0, 1.0, 1.0)
    assert len(path.travels) == 6
    again = json.loads(files_of(path)["toolpath.json"])
    for key in ("frame", "cutter", "requirements", "edge_length_mm"):
        assert again[key] == document[key]
    for one, other in zip(again["layers"], document["layers"], strict=True):
        assert (one["index"], one["height_mm"]) == (other["index"], other["height_mm"])
        for p, q in zip(one["points"], other["points"], strict=True):
            assert all(np.allclose(p[name], q[name], rtol=0, atol=1e-12) for name in EVERY)


def test_a_quaternion_of_the_other_sign_is_the_same_pose(tmp_path: Path, document: dict[str, Any]) -> None:
    (tmp_path / "as_is.json").write_text(json.dumps(document))
    for row in document["layers"]:
        for point in row["points"][3::2]:
            point["quaternion_wxyz"] = [-value for value in point["quaternion_wxyz"]]
    (tmp_path / "flipped.json").write_text(json.dumps(document))
    one, other = (read(toolpath=tmp_path / name) for name in ("as_is.json", "flipped.json"))
    for own, here in zip(one.layers, other.layers, strict=True):
        np.testing.assert_array_equal(own.quaternion_wxyz, here.quaternion_wxyz)


def test_what_the_contract_asks_for_is_enough(tmp_path: Path, document: dict[str, Any]) -> None:
    """No travels, requirements, heights and widths; a work object, a quaternion that is a little long."""
    bare: dict[str, Any] = {key: document[key] for key in ("format", "version")}
    bare["frame"], bare["base_from_workobject"] = "workobject", np.eye(4).tolist()
    bare["cutter"] = {"diameter_mm": 12.0, "flutes": 3}
    bare["layers"] = [
        {"index": layer["index"], "points": [{k: v for k, v in p.items() if k != "width_mm"} for p in layer["points"]]}
        for layer in document["layers"]
    ]
    bare["layers"][0]["points"][0]["quaternion_wxyz"] = [1.0005, 0, 0, 0]
    path = read(toolpath=written(tmp_path, bare))
    assert path.base_from_workobject is not None
    assert (path.cutter.diameter_mm, path.cutter.flutes) == (12.0, 3)
    assert path.travels == ()
    assert [layer.height_mm for layer in path.layers] == [4.0, 3.0, 2.0, 1.0, 0.0]
    assert np.isclose(np.linalg.norm(path.layers[0].quaternion_wxyz[0]), 1)
    for layer in path.layers:
        assert (layer.width_mm == np.where(layer.cutting, 1.0, 0.0)).all()


def put(*keys: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        inner: Any = document
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = value

    return change


POINT = ("layers", 1, "points", 3)


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (put("format", value="toolpath"), r"\$\.format"),
        (put("version", value=2), r"\$\.version"),
        (put("frame", value="world"), r"\$\.frame"),
        (put("frame", value="workobject"), "base_from_workobject"),
        (put("layers", value=[]), r"\$\.layers"),
        (put("layers", value={}), r"\$\.layers"),
        (put("layers", 1, value=3), r"layers\[1\]"),
        (put("layers", 1, "index", value=1), "indices of their own"),
        (put("layers", 1, "points", value=[]), r"layers\[1\]\.points"),
        (put(*POINT, value=None), r"layers\[1\]\.points\[3\]"),
        (put(*POINT, "position_mm", value=[1, 2]), r"layers\[1\]\.points\[3\]\.position_mm"),
        (put(*POINT, "position_mm", value=[1, 2, "a"]), r"layers\[1\]\.points\[3\]\.position_mm"),
        (put(*POINT, "feed_mm_s", value=0), r"points\[3\]\.feed_mm_s: expected"),
        (put(*POINT, "feed_mm_s", value=None), r"points\[3\]\.feed_mm_s"),
        (put(*POINT, "quaternion_wxyz", value=[1, 1, 0, 0]), "norm 1"),
        (put(*POINT, "cutting", value=1), r"points\[3\]\.cutting"),
        (put("layers", 1, "points", 80, "measured", value=False), "no cutting"),
        (put("cutter", value=None), r"\$\.cutter"),
        (put("cutter", "diameter_mm", value=-1), "diameter_mm"),
        (put("cutter", "flutes", value=2.5), "flutes"),
        (put("requirements", "root_mm", value="1"), r"requirements\.root_mm"),
        (put("travels", value=3), r"\$\.travels"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path, document, change, where):
    change(document)
    with pytest.raises(InputError, match=where) as error:
        read(toolpath=written(tmp_path, document))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (lambda point: point.update(position_mm=[v / 1000 for v in point["position_mm"]]), "0.001 mm a mm"),
        (lambda point: point.update(position_mm=[v / 10 for v in point["position_mm"]]), "cm"),
        (
            lambda point: point.update(quaternion_wxyz=np.roll(point["quaternion_wxyz"], -1).tolist()),
            "y along the feed",
        ),
        (lambda point: point.update(feed_mm_s=point["feed_mm_s"] / 1000), "in m/s"),
    ],
)
def test_metres_and_quaternions_in_another_order_are_told_by_the_path_itself(tmp_path, document, change, where):
    """Postures would be sought for them, at great length and in vain."""
    for layer in document["layers"]:
        for point in layer["points"]:
            change(point)
    with pytest.raises(InputError, match=rf"layers(\[0\]\.points)?: .*{where}"):
        read(toolpath=written(tmp_path, document))


def test_a_path_that_never_cuts_is_refused(tmp_path: Path, document: dict[str, Any]) -> None:
    for layer in document["layers"]:
        for point in layer["points"]:
            point["cutting"] = False
    with pytest.raises(InputError, match="points that cut"):
        read(toolpath=written(tmp_path, document))
