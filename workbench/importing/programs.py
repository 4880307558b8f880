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
from workbench.geometry.poses import USUAL_ANGLE_UNIT, components
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM
from workbench.importing.neutral import Imported, PoseStream
from workbench.importing.poses import of_flange_in_base, turned
from workbench.importing.text import read_text
from workbench.language import NUMBER, Language, Said, row
from workbench.program.fanuc import SPACE
from workbench.program.krl import FRAME
from workbench.program.rapid import TARGET
from workbench.program.urscript import POSE, VIA
from workbench.units import Float

NAME = "robot program (.ls, .mod, .src, .dat, .jbi, .script)"
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


def _positions(said: list[Said]) -> Float:
    """Of statements that say one."""
    rows = [[*one.values["at"], *one.values["turn"]] for one in said if "turn" in one.values]
    return np.array(rows, float)


def _of(said: list[Said], field: str) -> set[str]:
    """All that statements say of a field."""
    return {one.values[field] for one in said if field in one.values}


FANUC = Language(
    {"target": f"UF : {{frame}}, UT : {{tool}},{{more}}{SPACE.replace('{wpr[', '{turn[')}"},
    {},
    {"frame": r"\w+", "tool": r"\w+", "more": "[^{}]*?"},
)


def _fanuc(text: str) -> Positions:
    """Positions in joints have no X."""
    said = FANUC.search(text)
    return Positions(_positions(said), _of(said, "tool"), _of(said, "frame"))


ABB = Language(
    {"target": TARGET, "move": "{move}{before},{tool}{object}{rest};"},
    {},
    {
        **dict.fromkeys(("cf", "axes"), NUMBER),
        **{"move": r"\bMove[LJC]\b", "before": "[^;]*?", "tool": r"\w+"},
        **{"object": r"(?:\\WObj\s*:=\s*\w+)?", "rest": r"(?:\\[^;]*)?"},
    },
    comment="!",
)


def _abb(text: str) -> Positions:
    """Targets declared, or within a motion instruction."""
    said = ABB.search(text)
    tools = {tool.lower() for tool in _of(said, "tool")} or {NOT_TOLD}
    frames = {frame.rpartition("=")[2].strip().lower() or "wobj0" for frame in _of(said, "object")} or {NOT_TOLD}
    return Positions(_positions(said), tools, frames)


KUKA = Language(
    {
        "target": FRAME.replace("{{", "{brace}")[:-2],
        **{word: f"{word}{{{word.lower()}}}" for word in ("TOOL_NO", "BASE_NO")},
        **{word: f"{word}_DATA[{{{word.lower()}_no}}]" for word in ("TOOL", "BASE")},
        **{f"${word}": f"${word}={{{word.lower()}_own}}" for word in ("TOOL", "BASE")},
    },
    {},
    {
        **{"brace": r"\{[^{}]*?\b", **dict.fromkeys(("tool_no", "base_no"), r"\s*[0-9]+")},
        **dict.fromkeys(("tool_own", "base_own"), r"\$NULLFRAME|\{"),
    },
)


def _kuka(text: str) -> Positions:
    """POS and E6POS; tools and bases by FDAT, or `$TOOL`, `$BASE`."""
    code = re.sub(r"(?<!&);.*", "", text)
    said, found = KUKA.search(code), []
    for word in ("tool", "base"):
        own = {"0" if one.upper() == "$NULLFRAME" else f"${word.upper()}" for one in _of(said, f"{word}_own")}
        found.append({one.strip() for one in _of(said, f"{word}_no")} | own or {NOT_TOLD})
    moved = KUKA.search(re.sub(r"\$(?:TOOL|BASE)\s*=\s*\{[^}]*\}", "", code))
    rows = [one.values["frame"] for one in moved if one.form == "target"]
    return Positions(np.array(rows, float), *found)


YASKAWA = Language(
    {
        "head": "///{head} {value}",
        "row": f"{{variable}}={row([''] * 3, 'at', '.3f')},{row([''] * 3, 'turn', '.4f')}",
    },
    {},
    {"head": "POSTYPE|TOOL|USER", "value": r"\w+", "variable": r"\b[A-Z]+[0-9]+"},
)


def _yaskawa(text: str) -> Positions:
    """Rows under `///POSTYPE BASE`, `ROBOT` or `USER`; pulses are no positions."""
    holds, kept, tools, frames = {"POSTYPE": "PULSE", "TOOL": "0", "USER": "0"}, list[Said](), set[str](), set[str]()
    for said in YASKAWA.search(text):
        if said.form == "head":
            holds[said.values["head"].upper()] = said.values["value"]
        elif holds["POSTYPE"] != "PULSE":
            kept.append(said)
            tools.add(holds["TOOL"])
            frames.add(f"user {holds['USER']}" if holds["POSTYPE"] == "USER" else "0")
    return Positions(_positions(kept), tools, frames)


UR = Language({"target": POSE, "tool": f"set_tcp({VIA})"}, {}, {}, comment="#")


def _ur(text: str) -> Positions:
    """The tool's in the base; `set_tcp` tells the tool."""
    code = re.sub(r"#.*", "", text)
    tools = {"set_tcp" if any(one.values["via"]) else "0" for one in UR.search(code) if one.form == "tool"} or {
        NOT_TOLD
    }
    moved = UR.search(re.sub(r"\bset_(?:tcp|payload\w*)\s*\([^)]*\)", "", code))
    rows = [one.values["pose"] for one in moved]
    return Positions(np.array(rows, float), tools, {"pose_trans"} if "pose_trans" in code else {"0"})


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
    named = mapping.program is not None and mapping.program.claims(path)
    return named or re.search(MARKS[suffix], text, re.M | re.I) is not None


def read(path: Path, mapping: Mapping) -> Imported:
    """The flange's poses.

    Raises:
        InputError: no taught position, a position in joints, or a tool or a frame that the mapping does not tell.
    """
    maker = MAKERS[path.suffix.lower()]
    found = maker.positions(read_text(path))
    count = 3 + components(maker.convention)
    if not len(found.values) or found.values.shape[1] != count:
        expected = f"expected taught positions of {maker.name}, x, y, z and {maker.convention}"
        raise InputError(str(path), f"{expected}; found none (positions in joints or pulses are none)")
    part = mapping.program
    if part is None:
        _require_told(path, maker, found)
    unit = USUAL_ANGLE_UNIT.get(maker.convention, "rad")
    turn = turned(found.values[:, 3:], maker.convention, unit, lambda row: f"{path}: position {row + 1}")
    place = found.values[:, :3] * LENGTH_MM[maker.length_unit]
    if part is not None:
        place, turn = of_flange_in_base(place, turn, part)
    stream = PoseStream(str(path), place, turn, length_unit=maker.length_unit)
    named = f"tool {_list(found.tools)}, frame {_list(found.frames)}"
    note = f"{len(place)} positions of a {maker.name} program ({named}), {maker.convention}, no times"
    return Imported(poses=stream, notes=(note,))


def drafted(path: Path, error: InputError) -> tuple[dict[str, object], list[str]]:
    """The part `program`, as if tool and frame were flange and base, with its doubts; `error` where it is none."""
    maker = MAKERS[path.suffix.lower()]
    found = maker.positions(read_text(path))
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
