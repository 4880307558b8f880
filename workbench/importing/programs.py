"""Poses out of a FANUC program in text (.ls): the taught positions, in the order in which the file lists them.

Where a controller has taken one profile a position, its program holds the poses (`times.source`: `pose_each`).
Positions are those of a tool in a frame; a file that does not name the flange and the base needs the mapping's part
`program`, which tells both as matrices.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import quaternions
from workbench.importing.mapping import Mapping
from workbench.importing.neutral import Imported, PoseStream
from workbench.importing.poses import of_flange_in_base
from workbench.importing.text import read_text
from workbench.language import NUMBER
from workbench.units import DEG, Float

NAME = "FANUC program (.ls)"
ENDING = ".ls"
CONVENTION = "fanuc_wpr"
FORM = "X = @ mm , Y = @ mm , Z = @ mm , W = @ deg , P = @ deg , R = @ deg"  # @: a number; a blank: any white space
MARK = re.compile(r"^/PROG\b", re.M)
POSITION = re.compile(FORM.replace("@", f"({NUMBER})").replace(" ", r"\s*"), re.I)
TOOL, FRAME = re.compile(r"UT\s*:\s*(\w+)", re.I), re.compile(r"UF\s*:\s*(\w+)", re.I)
OWN, UNSTATED = "0", "not stated"  # number of the flange, and of the base


class Positions(NamedTuple):
    """What a program says of its taught positions."""

    values: Float  # (n, 6) x, y, z in mm; W, P, R in deg
    tools: set[str]
    frames: set[str]


def _positions(text: str) -> Positions:
    """The taught positions; those in joints are none."""
    rows = [[*map(float, one.groups())] for one in POSITION.finditer(text)]
    tools, frames = (set(form.findall(text)) or {UNSTATED} for form in (TOOL, FRAME))
    return Positions(np.array(rows, float), tools, frames)


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, or name and text are those of a program."""
    if path.suffix.lower() != ENDING:
        return False
    named = mapping.program is not None and mapping.program.claims(path)
    return named or MARK.search(head.decode("utf-8", "replace")) is not None


def read(path: Path, mapping: Mapping) -> Imported:
    """The flange's poses.

    Raises:
        InputError: no taught position, or a tool or a frame that the mapping does not tell.
    """
    found, part = _positions(read_text(path)), mapping.program
    if not len(found.values):
        raise InputError(str(path), "expected taught positions, x, y, z and W, P, R; found none (joints are none)")
    if part is None and not found.tools == found.frames == {OWN}:
        raise InputError(
            str(path),
            f"its positions are those of tool {_list(found.tools)} in frame {_list(found.frames)}: expected the "
            "mapping's part 'program' with flange_from_tool and base_from_frame (docs/importing.md)",
        )
    place, turn = found.values[:, :3], quaternions(found.values[:, 3:] * DEG, CONVENTION)
    if part is not None:
        place, turn = of_flange_in_base(place, turn, part)
    named = f"tool {_list(found.tools)}, frame {_list(found.frames)}"
    note = f"{len(place)} positions of a FANUC program ({named}), {CONVENTION}, no times"
    return Imported(poses=PoseStream(str(path), place, turn), notes=(note,))


def drafted(path: Path, error: InputError) -> tuple[dict[str, object], list[str]]:
    """The part `program`, as if tool and frame were flange and base, with its doubts; `error` where it is none."""
    found = _positions(read_text(path))
    if not len(found.values):
        raise error
    identity = np.eye(4).tolist()
    part: dict[str, object] = {"flange_from_tool": identity, "base_from_frame": identity}
    doubts = (
        (
            found.tools,
            f"program.flange_from_tool: the positions are those of tool {_list(found.tools)}; taken as the flange",
        ),
        (found.frames, f"program.base_from_frame: they are in frame {_list(found.frames)}; taken as the base"),
    )
    return part, [doubt for named, doubt in doubts if named != {OWN}]


def _list(names: set[str]) -> str:
    return ", ".join(sorted(names))
