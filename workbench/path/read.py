"""`path.read`: a milling path from a `toolpath.json`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import fields
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.artefacts import Cutter, Layer, Part, PartNames, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.poses import is_rigid
from workbench.path.claim import read_claim, read_evidence
from workbench.stage import InputFile, stage
from workbench.strict_json import read_json
from workbench.units import Bool, Float

MAX_BYTES = 2**28
LARGEST = sys.float_info.max  # JSON's whole numbers know no end
POSE = {"position_mm": (3,), "quaternion_wxyz": (4,), "feed_mm_s": ()}
DEFAULTS = {"root_mm": 1.5, "bevel_deg": 40.0, "depth_of_cut_mm": 1.0}  # the paper's, where the file is silent


@stage("path.read")
def read(*, toolpath: Annotated[InputFile, Field(description="a toolpath.json (docs/pipelines.md)")]) -> Toolpath:
    """Read a milling path from a `toolpath.json`, its own or another program's.

    What the contract does not ask for may be absent: travels, requirements, what its check said, and the width of the
    face that is cut, which is then taken as the depth of cut. Positions in mm, in the frame that the file names.

    Args:
        toolpath: the file.

    Raises:
        InputError: not such a file; the place in it and what was expected.
    """
    document = read_json(toolpath, MAX_BYTES)
    where = f"{toolpath}: $"
    _want(document.get("format") == "bevel-toolpath", f"{where}.format", "expected 'bevel-toolpath'")
    _want(document.get("version") == 1, f"{where}.version", "expected 1")
    wanted = document.get("requirements", {})
    _want(isinstance(wanted, dict), f"{where}.requirements", "expected an object")
    needs = {key: _size(wanted.get(key, default), f"{where}.requirements.{key}") for key, default in DEFAULTS.items()}
    layers = _layers(document.get("layers"), f"{where}.layers", needs["depth_of_cut_mm"])
    travels = _list(document.get("travels", []), f"{where}.travels")
    feeds, lengths = (
        np.concatenate([getattr(layer, name)[layer.cutting] for layer in layers])
        for name in ("feed_mm_s", "arc_length_mm")
    )
    _want(len(feeds) > 0, f"{where}.layers", "expected points that cut, found none")
    return Toolpath(
        cutter=_cutter(document.get("cutter"), f"{where}.cutter"),
        layers=layers,
        travels=tuple(_travel(one, f"{where}.travels[{i}]") for i, one in enumerate(travels)),
        v_slow_mm_s=float(feeds.min()),
        edge_length_mm=_size(document.get("edge_length_mm", float(lengths.max())), f"{where}.edge_length_mm"),
        base_from_workobject=_frame(document, where),
        source=str(toolpath),
        part=_part(document, where),
        root_mm=needs["root_mm"],
        bevel_deg=needs["bevel_deg"],
        depth_of_cut_mm=needs["depth_of_cut_mm"],
        claim=read_claim(document, where),
        evidence=read_evidence(document, where),
    )


def _layers(value: Any, where: str, depth_mm: float) -> tuple[Layer, ...]:
    rows = _list(value, where)
    _want(len(rows) > 0, where, "expected at least one layer")
    layers = tuple(_layer(row, f"{where}[{i}]", depth_mm, len(rows) - 1 - i) for i, row in enumerate(rows))
    indices = [layer.index for layer in layers]
    _want(len(set(indices)) == len(indices), where, "expected layers with indices of their own")
    return layers


def _layer(value: Any, where: str, depth_mm: float, above: int) -> Layer:
    """One layer; its height and the widths it cuts are optional."""
    _want(isinstance(value, dict), where, "expected an object")
    points = _list(value.get("points"), f"{where}.points")
    _want(len(points) > 1, f"{where}.points", "expected two points or more")
    index = value.get("index")
    _want(type(index) is int and index > 0, f"{where}.index", "expected a whole number from 1")
    cutting, measured = (_flags(points, name, f"{where}.points") for name in ("cutting", "measured"))
    _want(not (cutting & ~measured).any(), f"{where}.points", "expected no cutting where nothing was measured")
    given = [point.get("width_mm", depth_mm * bool(cuts)) for point, cuts in zip(points, cutting, strict=True)]
    return Layer(
        index=index,
        height_mm=_size(value.get("height_mm", above * depth_mm), f"{where}.height_mm", zero=True),
        arc_length_mm=_column([p.get("arc_length_mm") for p in points], (), f"{where}.points", "arc_length_mm"),
        cutting=cutting,
        measured=measured,
        width_mm=_column(given, (), f"{where}.points", "width_mm"),
        **_poses(points, f"{where}.points"),
    )


def _travel(value: Any, where: str) -> Travel:
    _want(isinstance(value, dict), where, "expected an object")
    return Travel(**_poses(_list(value.get("points"), f"{where}.points"), f"{where}.points"))


def _poses(points: list[Any], where: str) -> dict[str, Float]:
    """Positions, unit quaternions and feeds of points."""
    _want(all(isinstance(point, dict) for point in points), where, "expected objects")
    found = {name: _column([point.get(name) for point in points], shape, where, name) for name, shape in POSE.items()}
    norm = np.linalg.norm(found["quaternion_wxyz"], axis=1)
    _want(bool((np.abs(norm - 1) <= 1e-3).all()), where, "expected quaternions of norm 1 within 1e-3")
    found["quaternion_wxyz"] = found["quaternion_wxyz"] / norm[:, None]
    _want(bool((found["feed_mm_s"] > 0).all()), where, "expected feed_mm_s above 0")
    return found


def _column(values: list[Any], shape: tuple[int, ...], where: str, name: str) -> Float:
    """Numbers (n, *shape); the message names the first point that has none."""
    try:
        column = np.array(values, float)
    except (TypeError, ValueError, OverflowError):
        column = np.empty(0)
    if column.shape != (len(values), *shape) or not np.isfinite(column).all():
        bad = next((i for i, value in enumerate(values) if not _fits(value, shape)), 0)
        expected = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise InputError(f"{where}[{bad}].{name}", f"expected {expected}")
    return column


def _fits(value: Any, shape: tuple[int, ...]) -> bool:
    parts = value if shape and isinstance(value, list) else [value]
    numbers = all(type(x) in (int, float) and abs(x) <= LARGEST for x in parts)
    return numbers and len(parts) == (shape or (1,))[0]


def _flags(points: list[Any], name: str, where: str) -> Bool:
    for i, point in enumerate(points):
        _want(
            isinstance(point, dict) and type(point.get(name)) is bool, f"{where}[{i}].{name}", "expected true or false"
        )
    return np.array([point[name] for point in points], bool)


def _list(value: Any, where: str) -> list[Any]:
    _want(isinstance(value, list), where, "expected a list")
    return list(value)


def _size(value: Any, where: str, *, zero: bool = False) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST
    _want(good and (value > 0 or (zero and value == 0)), where, f"expected a number {'from' if zero else 'above'} 0")
    return float(value)


def _cutter(value: Any, where: str) -> Cutter:
    _want(isinstance(value, dict), where, "expected an object with diameter_mm and flutes")
    flutes = value.get("flutes")
    _want(type(flutes) is int and 1 <= flutes <= 100, f"{where}.flutes", "expected a whole number from 1 to 100")
    length = _size(value.get("flute_length_mm", Cutter().flute_length_mm), f"{where}.flute_length_mm")
    return Cutter(_size(value.get("diameter_mm"), f"{where}.diameter_mm"), flutes, length)


def _frame(document: Mapping[str, Any], where: str) -> Float | None:
    """`base_from_workobject`, or None for positions in the base."""
    frame = document.get("frame")
    _want(frame in ("base", "workobject"), f"{where}.frame", "expected 'base' or 'workobject'")
    if frame == "base":
        return None
    pose = _column(document.get("base_from_workobject") or [], (4,), where, "base_from_workobject")
    _want(pose.shape == (4, 4) and is_rigid(pose), f"{where}.base_from_workobject", "expected a rigid motion, 4x4")
    return pose


def _part(document: Mapping[str, Any], where: str) -> Part:
    """The part that the path is for, as far as the file says."""
    said = document.get("part") or {}
    _want(isinstance(said, dict), f"{where}.part", "expected an object")
    known: dict[str, Any] = {field.name: said.get(field.name) for field in fields(PartNames)}
    for name, text in known.items():
        _want(text is None or isinstance(text, str), f"{where}.part.{name}", "expected text or null")
    _want(said.get("simulated") in (None, True, False), f"{where}.part.simulated", "expected true, false or null")
    try:
        return Part(**known, simulated=said.get("simulated"))
    except ValueError as error:
        raise InputError(f"{where}.part", str(error)) from None


def _want(fulfilled: bool, where: str, expected: str) -> None:
    if not fulfilled:
        raise InputError(where, expected)
