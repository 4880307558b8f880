"""A strict reader for the part of KRL that milling programs need: `.src` and its `.dat`.

    src  = {& line} DEF name ( ) {statement} END
    statement = BAS (#INITMOV,0) | BAS (#VEL_PTP,n) | $TOOL = frame | $TOOL = TOOL_DATA[n] | $LOAD = ... | $BASE = frame
              | $BASE = BASE_DATA[n] | $IPO_MODE = #BASE | $ORI_TYPE = #VAR | $CIRC_TYPE = #BASE | $APO.CDIS = n
              | $VEL.CP = n | PTP name | LIN name [C_DIS] | CIRC name,name [C_DIS]
              | signal = (TRUE | FALSE) | WAIT FOR signal | WAIT SEC n | HALT | name: | name ( )
    signal    = $OUT[n] | $IN[n] | name
    dat  = {& line} DEFDAT name {DECL (E6AXIS | E6POS | POS) name = aggregate} ENDDAT

Everything else is refused with its line: a name that is not declared or of the wrong type, PTP to what is not E6AXIS
(the controller's home aside), a first move that is not PTP, a move before tool, base and feed were said, an external
axis other than E1, a signal or subprogram that the cell file's process does not name, a statement behind C_DIS.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.program.reading import NAME, NUMBER, Events, Lines, euler_pose, numbers, one_file
from workbench.robot.cell_file import ProcessPart
from workbench.units import DEG

FRAME = rf"\{{X {NUMBER},Y {NUMBER},Z {NUMBER},A {NUMBER},B {NUMBER},C {NUMBER}\}}"
POSE = FRAME[2:-2]
AXES = ",".join(rf"A{i} {NUMBER}" for i in range(1, 7))
EXTERNAL = rf"(?:,E1 {NUMBER})?"
LOAD = rf"\{{M {NUMBER},CM \{{X {NUMBER},Y {NUMBER},Z {NUMBER},A 0\.0,B 0\.0,C 0\.0\}},J \{{X 0\.0,Y 0\.0,Z 0\.0\}}\}}"
FIXED = ("$IPO_MODE=#BASE", "$ORI_TYPE=#VAR", "$CIRC_TYPE=#BASE", "BAS (#INITMOV,0)")


def read_krl(files: Mapping[str, str], process: ProcessPart | None = None) -> ProgramMoves:
    """Read a KRL program from its two files, name -> text.

    Args:
        files: one that ends in `.src`, and its `.dat`.
        process: whose signals switch what; None: a program that switches any is refused.

    Raises:
        InputError: "line 12: expected ..., found ...".
    """
    (src_name, src), (dat_name, dat) = one_file(files, ".src"), one_file(files, ".dat")
    return _Source(Lines(src, src_name, ";"), _data(Lines(dat, dat_name, ";")), process).read()


def _header(lines: Lines, word: str) -> None:
    while lines.peek().startswith("&"):
        lines.take(r"&.*", "a line of the header")
    lines.take(word, f"'{word.split()[0]} name'")


def _data(lines: Lines) -> dict[str, tuple[str, Any]]:
    """Declared positions: name -> type and what it says."""
    _header(lines, rf"DEFDAT {NAME}")
    declared: dict[str, tuple[str, Any]] = {}
    while (line := lines.peek()).startswith("DECL"):
        kind = line.split()[1] if len(line.split()) > 1 else ""
        wanted = {
            "E6AXIS": rf"\{{{AXES}{EXTERNAL}\}}",
            "E6POS": rf"\{{{POSE},S (\d+),T (\d+){EXTERNAL}\}}",
            "POS": FRAME,
        }
        shape = wanted.get(kind, "(?!)")
        found = lines.take(rf"DECL {kind} {NAME}={shape}", "a declaration of E6AXIS, E6POS or POS")
        if found[1] in declared:
            lines.refuse("a name that is not taken", found[1])
        declared[found[1]] = (kind, [float("nan" if one is None else one) for one in found.groups()[1:]])
    lines.take("ENDDAT", "a declaration or ENDDAT")
    lines.end()
    return declared


def _turntable(angle_deg: float) -> float | None:
    """E1 in rad; None: it is not commanded."""
    return None if math.isnan(angle_deg) else angle_deg * DEG


class _Source:
    """The statements, one after the other, with what was said before."""

    def __init__(self, lines: Lines, declared: dict[str, tuple[str, Any]], process: ProcessPart | None) -> None:
        self.lines, self.declared = lines, declared
        self.home = (process.home.controller_name if process else None) or ""
        self.said: set[str] = set()
        self.tool, self.base, self.load = "", "", (None, None)
        self.tools: dict[str, ProgramTool] = {}
        self.bases: dict[str, Any] = {}
        self.feed = self.zone = self.percent = 0.0
        self.moves: list[ProgramMove] = []
        self.labels: set[str] = set()
        self.events = Events(lines, self.moves, process)

    def read(self) -> ProgramMoves:
        lines = self.lines
        _header(lines, rf"DEF {NAME} \( \)")
        while lines.peek() not in ("END", ""):
            self.statement(lines.peek())
        lines.take("END", "a statement or END")
        lines.end()
        mass, centre = self.load
        tools = {key: ProgramTool(tool.flange_from_tool, mass, centre) for key, tool in self.tools.items()}
        return ProgramMoves(
            "kuka", lines.name, tuple(self.moves), tools, self.bases, tuple(self.events.found), tuple(lines.remarks)
        )

    def statement(self, line: str) -> None:
        lines, word = self.lines, re.split(r"[ =]", line)[0]
        if line in FIXED:
            self.said.add(lines.take(re.escape(line), line)[0])
        elif word == "BAS":
            self.percent = float(lines.take(rf"BAS \(#VEL_PTP,{NUMBER}\)", "BAS (#VEL_PTP,percent)")[1])
        elif word in ("$TOOL", "$BASE"):
            self.frame(word)
        elif word == "$LOAD":
            found = lines.take(rf"\$LOAD=(?:LOAD_DATA\[\d+\]|{LOAD})", "$LOAD=LOAD_DATA[n] or a load")
            self.load = (float(found[1]), np.array(numbers(found, 2, 4))) if found[1] else (None, None)  # type: ignore[assignment]
        elif word == "$VEL.CP":
            self.feed = 1000 * float(lines.take(rf"\$VEL\.CP={NUMBER}", "$VEL.CP=m/s")[1])
        elif word == "$APO.CDIS":
            self.zone = float(lines.take(rf"\$APO\.CDIS={NUMBER}", "$APO.CDIS=mm")[1])
        elif word in ("PTP", "LIN", "CIRC"):
            self.move(word)
        else:
            self.event()

    def event(self) -> None:
        """What happens between moves."""
        shapes = rf"(HALT)|WAIT SEC {NUMBER}|WAIT FOR (?:\$IN\[(\d+)\]|{NAME})|{NAME}:|{NAME} \( \)|"
        shapes += rf"(?:\$OUT\[(\d+)\]|{NAME})=(TRUE|FALSE)"
        found = self.lines.take(shapes, "a statement of this part of KRL (see workbench.program.krl_reader)")
        halt, seconds, number_in, name_in, label, routine, number_out, name_out, value = found.groups()
        if halt:
            self.events.add("stop", "")
        elif seconds:
            self.events.add("wait_time", seconds)
        elif label:
            if label in self.labels or label in self.declared:
                self.lines.refuse("a label that is not taken", label)
            self.labels.add(label)
            self.events.add("restart", label)
        elif routine:
            self.events.use("call", routine)
        elif value:
            self.events.use("1" if value == "TRUE" else "0", number_out or name_out)
        else:
            self.events.use("wait", number_in or name_in)

    def frame(self, word: str) -> None:
        """Tool or base: written out, or one of the controller's."""
        stored = "TOOL_DATA" if word == "$TOOL" else "BASE_DATA"
        found = self.lines.take(rf"\{word}=(?:({stored}\[\d+\])|{FRAME})", f"{word}={stored}[n] or a frame")
        pose = None if found[1] else euler_pose(numbers(found, 2, 7))
        if word == "$TOOL":
            self.tool = found[1] or "$TOOL"
            self.tools[self.tool] = ProgramTool(pose)
        else:
            self.base = found[1] or "$BASE"
            self.bases[self.base] = pose

    def move(self, word: str) -> None:
        lines = self.lines
        patterns = {"PTP": rf"PTP {NAME}", "LIN": rf"LIN {NAME}( C_DIS)?", "CIRC": rf"CIRC {NAME},{NAME}( C_DIS)?"}
        found = lines.take(patterns[word], f"'{word}' and names of positions")
        if not (self.tool and self.base and {*FIXED} <= self.said) or (word != "PTP" and self.feed <= 0):
            lines.refuse("tool, base, $IPO_MODE, $ORI_TYPE, $CIRC_TYPE and feed before the first move", found[0])
        if word != "PTP" and not self.moves:
            lines.refuse("PTP as the first move", found[0])
        if word == "PTP":
            if not 0 < self.percent <= 100:
                lines.refuse("BAS (#VEL_PTP,percent) of 1 to 100 before PTP", found[0])
            if self.moves and self.moves[-1].zone_mm > 0:
                lines.refuse("a move that reaches its target before PTP", found[0])
            known = found[1] not in self.declared and found[1] == self.home
            values = [math.nan] * 7 if known else self.position(found[1], "E6AXIS")
            move = ProgramMove(
                lines.number,
                "J",
                self.tool,
                self.base,
                joint_speed=self.percent / 100,
                joints=None if known else np.array(values[:6]) * DEG,
                turntable=_turntable(values[6]),
                place=self.home if known else "",
            )
        else:
            values = self.position(found[(word == "CIRC" and 2) or 1], "E6POS")
            via = euler_pose(self.position(found[1], "POS")) if word == "CIRC" else None
            move = ProgramMove(
                lines.number,
                "C" if via is not None else "L",
                self.tool,
                self.base,
                pose=euler_pose(values[:6]),
                via=via,
                feed_mm_s=self.feed,
                zone_mm=self.zone if found[len(found.groups())] else 0.0,
                turntable=_turntable(values[8]),
                configuration=(int(values[6]), int(values[7])),
            )
        self.moves.append(move)

    def position(self, name: str, kind: str) -> list[float]:
        """What the data list says of a name."""
        declared, values = self.declared.get(name, ("nothing", None))
        if declared != kind:
            self.lines.refuse(f"the name of {kind} that the data list declares", name)
        assert values is not None
        return list(values)
