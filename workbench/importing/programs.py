"""Poses out of robot programs: the taught positions, in the order in which the file lists them.

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
from workbench.geometry.poses import USUAL_ANGLE_UNIT, components
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import LENGTH_MM
from workbench.importing.neutral import Imported, PoseStream
from workbench.importing.poses import of_flange_in_base, turned
from workbench.importing.text import read_text
from workbench.language import NUMBER
from workbench.units import Float

NAME = "robot program (.ls, .mod, .src, .dat, .jbi, .script)"
NOT_TOLD = "not stated"


class Maker(NamedTuple):
    """How a maker writes positions, tools and frames: patterns in which @ is a number and a blank any white space."""

    name: str
    convention: str
    mark: str  # that its programs have, for names that others use too
    position: str  # x, y, z and the orientation in the maker's convention
    tool: str  # as the maker counts or calls them; '' or zeros: the flange
    frame: str  # likewise; the base
    remark: str = ""  # where neither positions nor names count
    aside: str = ""  # what looks like a position and is none; the names in it count
    length_unit: str = "mm"
    untold: tuple[str, str] = (NOT_TOLD, NOT_TOLD)  # tool and frame where the file has no word of it


SIX = " , ".join("@" * 6)
KUKA_OF = r"{0}_NO ([0-9]+)|{0}_DATA\[ ([0-9]+)|\${0} = \$(NULLFRAME)|(\${0}) =(?! \$NULLFRAME| {0}_DATA)"
KUKA = Maker(
    "KUKA",
    "kuka_abc",
    r"^ DEF(?:DAT)?\b",
    r"\{[^{}]*?\bX @ , Y @ , Z @ , A @ , B @ , C @",
    KUKA_OF.format("TOOL"),
    KUKA_OF.format("BASE"),
    r"(?<!&);.*",
    r"\$(?:TOOL|BASE) = \{[^}]{0,200}\}",
)
MAKERS = {
    ".ls": Maker(
        "FANUC",
        "fanuc_wpr",
        r"^/PROG\b",
        "X = @ mm , Y = @ mm , Z = @ mm , W = @ deg , P = @ deg , R = @ deg",
        r"UT : (\w+)",
        r"UF : (\w+)",
    ),
    ".mod": Maker(
        "ABB",
        "abb",
        r"^ (?:%%%|MODULE\b)|\brobtarget\b",
        r"\[ \[ @ , @ , @ \] , \[ @ , @ , @ , @ \] , \[",
        r"\bMove[LJC]\b[^;]{0,400}?, (?:tool0|(\w+)) (?:\\[^;]{0,200})?;",
        r"\bMove[LJC]\b[^;]{0,400}?(?:\\WObj := (?:wobj0|(\w+))[^;]{0,200})?;",
        "!.*",
    ),
    ".src": KUKA,
    ".dat": KUKA,
    ".jbi": Maker(
        "Yaskawa",
        "yaskawa_rxyz",
        r"^/JOB\b",
        rf"\b[A-Z]+[0-9]+ = {SIX}",
        r"///TOOL (\w+)",
        r"///POSTYPE (USER)\b",
        aside=r"///POSTYPE PULSE[\s\S]*?(?=///POSTYPE|//INST|\Z)",
        untold=("", ""),
    ),
    ".script": Maker(
        "Universal Robots",
        "ur",
        r"\bp\[",
        rf"\bp\[ {SIX} \]",
        r"\bset_tcp \( ([^)]{0,200})",
        r"\b(pose_trans)\b",
        "#.*",
        r"\bset_(?:tcp|payload\w*) \([^)]{0,200}\)",
        "m",
        (NOT_TOLD, ""),
    ),
}
OWN = re.compile(r"NULLFRAME|(?:p\[)?[0.,\s]*\]?", re.I)  # what names the flange, or the base


class Positions(NamedTuple):
    """What a program says of its taught positions."""

    values: Float  # (n, 6 or 7) x, y, z and the orientation in the maker's convention
    tools: set[str]  # '': the flange
    frames: set[str]  # '': the base


def _pattern(form: str) -> re.Pattern[str]:
    return re.compile(form.replace("@", f"({NUMBER})").replace(" ", r"\s*"), re.I | re.M)


def _positions(maker: Maker, text: str) -> Positions:
    """The taught positions; those in joints or pulses are none."""
    code = _pattern(maker.remark).sub("", text)
    moved = _pattern(maker.aside).sub("", code)
    rows = [[*map(float, one.groups())] for one in _pattern(maker.position).finditer(moved)]
    named = []
    for form, untold in zip((maker.tool, maker.frame), maker.untold, strict=True):
        found = {next(filter(None, one.groups()), "") for one in _pattern(form).finditer(code)}
        named.append({"" if OWN.fullmatch(name) else name.lower() for name in found} or {untold})
    return Positions(np.array(rows, float), *named)


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether the mapping names the file, or name and text are those of a maker's program."""
    suffix = path.suffix.lower()
    if suffix not in MAKERS:
        return False
    named = mapping.program is not None and mapping.program.claims(path)
    return named or _pattern(MAKERS[suffix].mark).search(head.decode("utf-8", "replace")) is not None


def read(path: Path, mapping: Mapping) -> Imported:
    """The flange's poses.

    Raises:
        InputError: no taught position, a position in joints, or a tool or a frame that the mapping does not tell.
    """
    maker = MAKERS[path.suffix.lower()]
    found = _positions(maker, read_text(path))
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
    found = _positions(maker, read_text(path))
    if not len(found.values):
        raise error
    identity = np.eye(4).tolist()
    part: dict[str, object] = {"flange_from_tool": identity, "base_from_frame": identity}
    doubts = [
        f"program.flange_from_tool: the positions are those of tool {_list(found.tools)}; taken as the flange",
        f"program.base_from_frame: they are in frame {_list(found.frames)}; taken as the base",
    ]
    own = (found.tools == {""}, found.frames == {""})
    return part, [doubt for doubt, is_own in zip(doubts, own, strict=True) if not is_own]


def _require_told(path: Path, maker: Maker, found: Positions) -> None:
    """Refuse positions of a tool, or in a frame, that may not be the flange and the base."""
    if found.tools == found.frames == {""}:
        return
    raise InputError(
        str(path),
        f"its positions are those of tool {_list(found.tools)} in frame {_list(found.frames)} of a {maker.name}: "
        "expected the mapping's part 'program' with flange_from_tool and base_from_frame (docs/importing.md)",
    )


def _list(names: set[str]) -> str:
    return ", ".join(name or "0" for name in sorted(names))
