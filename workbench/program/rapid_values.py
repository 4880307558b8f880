"""Values of RAPID's data types, read from tokens: records in brackets, their parts checked."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from workbench.program.rapid_program import JointTarget, Pose, RobTarget, ToolData, WorkObject
from workbench.program.rapid_tokens import Tokens

NORM_TOLERANCE = 1e-3  # of quaternions (docs/conventions.md)

# What a value of each type consists of; `orient` is a unit quaternion.
POS = ("num",) * 3
POSE = (POS, "orient")
AXES = ("num",) * 6
SHAPES: dict[str, tuple[Any, ...]] = {
    "robtarget": (POS, "orient", ("num",) * 4, AXES),
    "jointtarget": (AXES, AXES),
    "tooldata": ("bool", POSE, ("num", POS, "orient", "num", "num", "num")),
    "wobjdata": ("bool", "bool", "string", POSE, POSE),
    "speeddata": ("num",) * 4,
    "zonedata": ("bool", *("num",) * 6),
}
NO_POSE = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
TOOL0 = ToolData(True, NO_POSE, 0.001, (0.0, 0.0, 0.001))
WOBJ0 = WorkObject(False, NO_POSE, NO_POSE)


def read_value(tokens: Tokens, kind: str) -> Any:
    """A value of one type, written out; InputError with its line where it is none."""
    begin, value = tokens.at, _record(tokens, SHAPES[kind])
    if kind == "speeddata" and min(value) <= 0:
        tokens.refuse("speeds above 0", begin)
    if kind == "zonedata" and min(value[1:]) < 0:
        tokens.refuse("zones of 0 or more", begin)
    return MAKERS[kind](value) if kind in MAKERS else value


def _record(tokens: Tokens, shape: tuple[Any, ...]) -> tuple[Any, ...]:
    """Parts in brackets, a comma between them."""
    tokens.take("[")
    parts = []
    for i, part in enumerate(shape):
        if i:
            tokens.take(",")
        parts.append(_record(tokens, part) if isinstance(part, tuple) else LEAVES[part](tokens))
    tokens.take("]")
    return tuple(parts)


def _orient(tokens: Tokens) -> tuple[float, ...]:
    begin, q = tokens.at, _record(tokens, ("num",) * 4)
    norm = math.hypot(*q)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        tokens.refuse(f"a quaternion of unit length, not {norm:.6g}", begin)
    return q


def _boolean(tokens: Tokens) -> bool:
    return tokens.take("true", "false") == "true"


LEAVES: dict[str, Callable[[Tokens], Any]] = {
    "num": Tokens.number,
    "bool": _boolean,
    "string": Tokens.string,
    "orient": _orient,
}
MAKERS: dict[str, Callable[[Any], Any]] = {
    "robtarget": RobTarget._make,
    "jointtarget": JointTarget._make,
    "tooldata": lambda v: ToolData(v[0], Pose(*v[1]), v[2][0], v[2][1]),
    "wobjdata": lambda v: WorkObject(v[0], Pose(*v[3]), Pose(*v[4])),
}
