"""How well a calibrated tool, or turntable, is known: what its file states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from workbench.errors import InputError
from workbench.strict_json import read_json


def tool_u(path: Path, unknown_deg: float) -> tuple[float, float]:
    """u of the tip (mm, least certain direction) and of the axis (deg; `unknown_deg` where none was measured).

    Raises:
        InputError: no tcp.json.
    """
    found, where = read_json(path), f"{path}: $"
    _want(found.get("format") == "tool-calibration", f"{where}.format", "expected 'tool-calibration'")
    points, axis = found.get("points"), found.get("axis")
    if not isinstance(points, list) or not points or not isinstance(points[0], dict):
        raise InputError(f"{where}.points", "expected a list of points")
    _want(axis is None or isinstance(axis, dict), f"{where}.axis", "expected an axis or null")
    u_deg = unknown_deg if axis is None else _size(axis.get("u_deg"), f"{where}.axis.u_deg")
    return _size(points[0].get("u_mm"), f"{where}.points[0].u_mm"), u_deg


def turntable_u(path: Path) -> tuple[float, float]:
    """u of a point by the table's axis (mm, least certain direction) and of its direction (deg).

    Raises:
        InputError: no turntable.json.
    """
    found, where = read_json(path), f"{path}: $"
    _want(found.get("format") == "turntable-calibration", f"{where}.format", "expected 'turntable-calibration'")
    u_mm, u_deg = (_size(found.get(key), f"{where}.{key}") for key in ("u_mm", "direction_u_deg"))
    return u_mm, u_deg


def _size(value: Any, where: str) -> float:
    _want(type(value) in (int, float) and 0.0 <= value <= 1e6, where, "expected a number from 0")
    return float(value)


def _want(fulfilled: bool, where: str, expected: str) -> None:
    if not fulfilled:
        raise InputError(where, expected)
