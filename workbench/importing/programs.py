"""Poses out of robot programs: the taught positions, in the order in which the file lists them.

Where a controller has taken one profile a position, its program holds the poses (`times.source`: `pose_each`).
Positions are those of a tool in a frame; a file that does not name the flange and the base needs the mapping's part
`program`, which tells both as matrices.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import USUAL_ANGLE_UNIT, components, quaternions
from workbench.importing.mapping import Mapping, claims
from workbench.importing.mapping_parts import LENGTH_MM
from workbench.importing.neutral import Imported, PoseStream
from workbench.importing.poses import of_flange_in_base
from workbench.importing.text import read_lines_as_bytes
from workbench.scan.checks import UNIT_TOLERANCE
from workbench.units import DEG, Float

NAME = "robot program (.ls, .mod, .src, .dat, .jbi, .script)"
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
LIST = rf"\s*{NUMBER}(?:\s*,\s*{NUMBER})*\s*"
PLACE, TURN = (rf"\[(\s*{NUMBER}(?:\s*,\s*{NUMBER}){{{more}}}\s*)\]" for more in (2, 3))
NOT_TOLD = "not told"


class Positions(NamedTuple):
    """What a program says of its taught positions."""

    values: Float  # (n, 6 or 7) x, y, z and the orientation in the maker's convention
    tools: set[str]  # as the maker counts or calls them; NOT_TOLD where the file has no word of it
    frames: set[str]


class Maker(NamedTuple):
    """How a maker writes positions, and by what names it calls the flange and the base."""

    name: str
    convention: str
    length_unit: str
    flange: str
    base: str
    positions: Callable[[str], Positions]


def _numbered(matches: list[str]) -> Float:
    return np.array([[float(one) for one in re.findall(NUMBER, text)] for text in matches], float)


def _fanuc(text: str) -> Positions:
    """`P[1]{ GP1: UF : 0, UT : 0, CONFIG : '...', X = 1 mm, ... R = 2 deg };`; positions in joints have no X."""
    blocks = re.findall(r"^P\[[^\]]*\]\s*\{(.*?)\};", text, re.S | re.M)
    told = [re.findall(rf"\b[XYZWPR]\s*=\s*({NUMBER})\s*(?:mm|deg)", block)[:6] for block in blocks]
    values = np.array([[float(one) for one in six] for six in told if len(six) == 6], float)
    found = [set(re.findall(rf"\b{word}\s*:\s*(\w+)", "".join(blocks))) for word in ("UT", "UF")]
    return Positions(values, *found)


def _abb(text: str) -> Positions:
    """`[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[...]]`, declared as robtarget or within a motion instruction."""
    code = re.sub(r"!.*", "", text)
    targets = re.findall(rf"\[\s*{PLACE}\s*,\s*{TURN}\s*,\s*\[{LIST}\]\s*,\s*\[{LIST}\]\s*\]", code)
    moves = re.findall(r"\bMove[LJC]\b[^;]*?,\s*(\w+)\s*(?:\\WObj\s*:=\s*(\w+)\s*)?(?:\\[^;]*)?;", code, re.I)
    tools = {tool.lower() for tool, _ in moves} or {NOT_TOLD}
    frames = {(frame or "wobj0").lower() for _, frame in moves} or {NOT_TOLD}
    return Positions(_numbered([f"{place} {turn}" for place, turn in targets]), tools, frames)


def _kuka(text: str) -> Positions:
    """`{X 1,Y 2,Z 3,A 4,B 5,C 6,...}` of POS and E6POS; tools and bases by FDAT, or `$TOOL`, `$BASE`."""
    code = re.sub(r"(?<!&);.*", "", text)
    moved = re.sub(r"\$(?:TOOL|BASE)\s*=\s*\{[^}]*\}", "", code)
    marks = ("X", "Y", "Z", "A", "B", "C")
    form = r"\{[^{}]*?" + r"\s*,\s*".join(rf"\b{mark}\s+({NUMBER})" for mark in marks)
    values = np.array([[float(one) for one in six] for six in re.findall(form, moved)], float)
    found = []
    for word in ("TOOL", "BASE"):
        numbers = set(re.findall(rf"\b{word}_NO\s+(\d+)", code)) | set(re.findall(rf"{word}_DATA\[(\d+)\]", code))
        if re.search(rf"\${word}\s*=\s*\$NULLFRAME", code, re.I):
            numbers.add("0")
        found.append(numbers | ({"$" + word} if re.search(rf"\${word}\s*=\s*\{{", code) else set()) or {NOT_TOLD})
    return Positions(values, *found)


def _yaskawa(text: str) -> Positions:
    """`C00000=x,y,z,rx,ry,rz` under `///POSTYPE BASE`, `ROBOT` or `USER`; pulses are no positions."""
    values, tools, frames = [], set[str](), set[str]()
    kind, tool, frame = "", "0", "0"
    for line in text.splitlines():
        if head := re.match(r"///(POSTYPE|TOOL|USER)\s+(\w+)", line):
            kind = head[2] if head[1] == "POSTYPE" else kind
            tool = head[2] if head[1] == "TOOL" else tool
            frame = head[2] if head[1] == "USER" else frame
        elif kind and kind != "PULSE" and (row := re.match(rf"[A-Z]+\d+=({LIST})$", line.strip())):
            values.append(_numbered([row[1]])[0, :6])
            tools.add(tool)
            frames.add(f"user {frame}" if kind == "USER" else "0")
    return Positions(np.array(values, float), tools, frames)


def _ur(text: str) -> Positions:
    """`p[x, y, z, rx, ry, rz]` in m and rad, the tool's in the base; `set_tcp` tells the tool."""
    code = re.sub(r"#.*", "", text)
    tcp = re.findall(rf"\bset_tcp\s*\(\s*p\[({LIST})\]", code)
    poses = re.findall(rf"\bp\[({LIST})\]", re.sub(r"\bset_(?:tcp|payload\w*)\s*\([^)]*\)", "", code))
    tools = {"0" if not _numbered([one]).any() else "set_tcp" for one in tcp} or {NOT_TOLD}
    return Positions(_numbered(poses), tools, {"pose_trans"} if "pose_trans" in code else {"0"})


MAKERS = {
    ".ls": Maker("FANUC", "fanuc_wpr", "mm", "0", "0", _fanuc),
    ".mod": Maker("ABB", "abb", "mm", "tool0", "wobj0", _abb),
    ".src": Maker("KUKA", "kuka_abc", "mm", "0", "0", _kuka),
    ".dat": Maker("KUKA", "kuka_abc", "mm", "0", "0", _kuka),
    ".jbi": Maker("Yaskawa", "yaskawa_rxyz", "mm", "0", "0", _yaskawa),
    ".script": Maker("Universal Robots", "ur", "m", "0", "0", _ur),
}
MARKS = {  # what stands in a program of the maker's, for names that others use too
    ".ls": r"^/PROG\b",
    ".mod": r"^\s*(?:%%%|MODULE\b)|\brobtarget\b",
    ".src": r"^\s*DEF\b",
    ".dat": r"^\s*DEFDAT\b",
    ".jbi": r"^/JOB\b",
    ".script": r"\bp\[",
}


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, or name and text are those of a maker's program."""
    suffix = path.suffix.lower()
    if suffix not in MAKERS:
        return False
    text = head.decode("utf-8", "replace")
    return claims(mapping.program, path) or re.search(MARKS[suffix], text, re.M | re.I) is not None


def read(path: Path, mapping: Mapping) -> Imported:
    """The flange's poses.

    Raises:
        InputError: no taught position, a position in joints, or a tool or a frame that the mapping does not tell.
    """
    maker = MAKERS[path.suffix.lower()]
    found = maker.positions(read_lines_as_bytes(path).decode("utf-8", "replace"))
    count = 3 + components(maker.convention)
    if not len(found.values) or found.values.shape[1] != count:
        expected = f"expected taught positions of {maker.name}, x, y, z and {maker.convention}"
        raise InputError(str(path), f"{expected}; found none (positions in joints or pulses are none)")
    part = mapping.program
    if part is None:
        _require_told(path, maker, found)
    values = found.values[:, 3:] * (DEG if USUAL_ANGLE_UNIT.get(maker.convention) == "deg" else 1.0)
    quaternion = quaternions(values, maker.convention)
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    if (np.abs(norm - 1.0) > UNIT_TOLERANCE).any():
        worst = int(np.abs(norm - 1.0).argmax())
        raise InputError(
            f"{path}: position {worst + 1}", f"expected a quaternion of norm 1, found {norm[worst, 0]:.4g}"
        )
    position_mm = found.values[:, :3] * LENGTH_MM[maker.length_unit]
    place, turn = position_mm, quaternion / norm
    if part is not None:
        place, turn = of_flange_in_base(place, turn, part)
    stream = PoseStream(str(path), place, turn, length_unit=maker.length_unit)
    named = f"tool {_list(found.tools)}, frame {_list(found.frames)}"
    note = f"{len(place)} positions of a {maker.name} program ({named}), {maker.convention}, no times"
    return Imported(poses=stream, notes=(note,))


def drafted(path: Path, error: InputError) -> tuple[dict[str, object], list[str]]:
    """The part `program`, as if tool and frame were flange and base, with its doubts; `error` where it is none."""
    maker = MAKERS[path.suffix.lower()]
    found = maker.positions(read_lines_as_bytes(path).decode("utf-8", "replace"))
    if not len(found.values):
        raise error
    identity = np.eye(4).tolist()
    part: dict[str, object] = {"flange_from_tool": identity, "base_from_frame": identity}
    doubts = [
        f"program.flange_from_tool: the positions are those of tool {_list(found.tools)}; taken as the flange",
        f"program.base_from_frame: they stand in frame {_list(found.frames)}; taken as the base",
    ]
    own = (found.tools != {maker.flange}, found.frames != {maker.base})
    return part, [doubt for doubt, is_own in zip(doubts, own, strict=True) if is_own]


def _require_told(path: Path, maker: Maker, found: Positions) -> None:
    """Refuse positions of a tool, or in a frame, that may not be the flange and the base."""
    if found.tools == {maker.flange} and found.frames == {maker.base}:
        return
    raise InputError(
        str(path),
        f"its positions are those of tool {_list(found.tools)} in frame {_list(found.frames)} of a {maker.name}: "
        "expected the mapping's part 'program' with flange_from_tool and base_from_frame (docs/importing.md)",
    )


def _list(names: set[str]) -> str:
    return ", ".join(sorted(names)) or NOT_TOLD
