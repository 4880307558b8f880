"""KRL, KUKA's language: the path as `.src` (moves) and `.dat` (targets).

(KUKA System Software, Operating and Programming Instructions for System Integrators.) Targets are E6POS in $BASE: X,
Y, Z in mm, and R = Rz(A) Ry(B) Rx(C) with A, B, C in deg; STATUS (S) and TURN (T) of the robot's posture; E1, the
turntable, in deg. The program begins with PTP to the first posture (E6AXIS), as KRL asks. Feeds are $VEL.CP in m/s.
Circular moves turn the tool in the frame of the base ($ORI_TYPE = #VAR, $CIRC_TYPE = #BASE), as `path.simplify`
assumes. With C_DIS the next move blends in $APO.CDIS mm before the target. STATUS: bit 0, the wrist's centre is
behind axis 1; bit 1, the elbow is up; bit 2, A5 is negative. TURN: bit i, axis i + 1 is negative.

Read back strictly, and no more of it than milling programs need: `.src` and its `.dat`.

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

import functools
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.artefacts import EventKind, ProgramMove, ProgramMoves, ProgramTool
from workbench.dialect import rounded_feeds
from workbench.errors import InputError
from workbench.geometry.poses import rotation_from_quaternion
from workbench.program.skeleton import CellDialect, check_words, limited
from workbench.program.words import NAME, NUMBER, Events, Lines, euler_pose, numbers, one_file
from workbench.robot.cell import Cell
from workbench.robot.cell_file import ProcessPart
from workbench.robot.wrist import arm_sides
from workbench.units import DEG, Float, Int

PTP_PERCENT = 20  # of the axes' largest speeds, on the way to the first posture
FRAME = rf"\{{X {NUMBER},Y {NUMBER},Z {NUMBER},A {NUMBER},B {NUMBER},C {NUMBER}\}}"
POSE = FRAME[2:-2]
AXES = ",".join(rf"A{i} {NUMBER}" for i in range(1, 7))
EXTERNAL = rf"(?:,E1 {NUMBER})?"
LOAD = rf"\{{M {NUMBER},CM \{{X {NUMBER},Y {NUMBER},Z {NUMBER},A 0\.0,B 0\.0,C 0\.0\}},J \{{X 0\.0,Y 0\.0,Z 0\.0\}}\}}"
FIXED = ("$IPO_MODE=#BASE", "$ORI_TYPE=#VAR", "$CIRC_TYPE=#BASE", "BAS (#INITMOV,0)")


@dataclass
class Krl(CellDialect):
    """The dialect of KUKA's controllers."""

    def __post_init__(self) -> None:
        """Refuse names that are none of the controller's."""
        for what, name in (("TOOL_DATA", self.job.tool_name), ("BASE_DATA", self.job.work_object_name)):
            if name is not None and not re.fullmatch(rf"{what}\[\d+\]", name):
                raise InputError(f"{self.cell.source}: controller_name", f"expected {what}[n] for KUKA, found {name!r}")
        if self.cell.process is not None:
            check_words(self.cell, self.cell.process, "KUKA", signals="both")

    def event(self, kind: EventKind, value: str) -> list[str]:
        """What happens between moves: $OUT, WAIT FOR $IN, WAIT SEC, HALT, labels, subprograms.

        All of them stop the advance run. WAIT FOR waits without end. Feeds are limited where they are written.
        """
        words: dict[EventKind, list[str]] = {
            "hook": [f"{value} ( )"],
            "stop": ["HALT"],
            "wait_time": [f"WAIT SEC {value}"],
            "feed_limits": [],
            "wait_speed": [f"WAIT FOR {_signal('$IN', value)}"],
            "restart": [f"{value.upper()}:", *self._modes()],
        }
        switched = {"on": "TRUE", "off": "FALSE"}.get(kind.rpartition("_")[2])
        return [f"  {line}" for line in ([f"{_signal('$OUT', value)}={switched}"] if switched else words[kind])]

    @functools.cached_property
    def feeds(self) -> list[float]:
        """Of the moves, mm/s."""
        rounded: list[float] = rounded_feeds(limited(self.job.moves.feed_mm_s, self.cell)).tolist()
        return rounded

    def head(self) -> Iterator[str]:
        """Remarks, tool, load, base and how to move."""
        job = self.job
        yield from ("&ACCESS RVP", f"DEF {job.name} ( )")
        yield from (f"  ; {remark}" for remark in job.remarks)
        yield from self.said(self.skeleton.first) if self.skeleton else ()
        yield from (f"  {line}" for line in self._modes())

    def _modes(self) -> Iterator[str]:
        """All that holds until it is said otherwise; again at every restart point."""
        job = self.job
        yield from ("BAS (#INITMOV,0)", f"BAS (#VEL_PTP,{PTP_PERCENT})")
        if job.tool_name is not None:
            yield f"$TOOL={job.tool_name}"
            yield f"$LOAD={job.tool_name.replace('TOOL', 'LOAD')}"
        else:
            x, y, z = job.tool.centre_of_gravity_mm
            yield f"$TOOL={frame(job.tool_centre_point_mm, job.tool.quaternion_wxyz)}"
            centre = f"CM {{X {x:.4f},Y {y:.4f},Z {z:.4f},A 0.0,B 0.0,C 0.0}}"
            yield f"$LOAD={{M {job.tool.mass_kg:g},{centre},J {{X 0.0,Y 0.0,Z 0.0}}}}"
        yield f"$BASE={job.work_object_name or frame(*job.work_object)}"
        yield from ("$IPO_MODE=#BASE", "$ORI_TYPE=#VAR", "$CIRC_TYPE=#BASE", f"$APO.CDIS={job.zone_mm:g}")

    def start(self) -> Iterable[str]:
        """By the axes to the first posture; with a process from home, and straight to the first target."""
        if self.skeleton is None:
            return ["  PTP XSTART"]
        on = self.said(self.skeleton.on)
        return [
            f"  PTP {self._home}",
            *self.probed("  PTP XPROBE"),
            "  PTP XSTART",
            *on,
            self._velocity(0),
            "  LIN XP1",
        ]

    @property
    def _home(self) -> str:
        assert self.skeleton is not None
        return self.skeleton.process.home.controller_name or "XPARK"

    def _begin(self, i: int) -> list[str]:
        """What stands before a move: where a layer begins, and its feed if it is another than before."""
        layer = self.layer(i)
        changed = i == 1 or bool(layer) or self.feeds[i] != self.feeds[i - 1]
        return [*layer, *([self._velocity(i)] if changed else [])]

    def straight(self, i: int) -> Iterable[str]:
        """LIN."""
        return [*self._begin(i), f"  LIN XP{i + 1}{self._blend(i)}"]

    def circular(self, i: int) -> Iterable[str]:
        """CIRC."""
        return [*self._begin(i), f"  CIRC XV{i + 1},XP{i + 1}{self._blend(i)}"]

    def remark(self, text: str) -> str:
        """Up to the end of the line."""
        return f"  ; {text}"

    def foot(self) -> Iterable[str]:
        """The end; with a process back, and home."""
        skeleton = self.skeleton
        if skeleton is None:
            return ["END"]
        return ["  LIN XRETRACT", *self.said(skeleton.off), f"  PTP {self._home}", *self.said(skeleton.last), "END"]

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return read_krl(files, self.cell.process)

    def configuration(self, joints: Float, cell: Cell) -> tuple[int, ...]:
        """STATUS and TURN of a posture (6,), rad."""
        return tuple(status_and_turn(cell, joints[None])[0].tolist())

    def documents(self, text: str) -> dict[str, str]:
        """The moves, and the data list with their targets."""
        name = self.job.name
        return {f"{name}.src": text, f"{name}.dat": "\n".join([*self._data(), ""])}

    def _velocity(self, i: int) -> str:
        return f"  $VEL.CP={self.feeds[i] / 1000:.9g}"

    def _blend(self, i: int) -> str:
        return " C_DIS" if self.blends[i] else ""

    def _data(self) -> Iterator[str]:
        """The data list: first posture, targets, middles of arcs."""
        moves = self.job.moves
        assert moves.joints_deg is not None
        joints = moves.joints_deg
        turned = self.job.turntable_deg
        external = [""] * len(joints)  # what an aggregate does not name stays where it is
        if turned is not None:
            external = [f",E1 {angle + 0.0:.4f}" for angle in np.round(turned, 4).tolist()]
        yield from ("&ACCESS RVP", f"DEFDAT {self.job.name}")
        targets = frames(moves.position_mm, moves.quaternion_wxyz)
        said = status_and_turn(self.cell, joints * DEG).tolist()
        skeleton = self.skeleton
        if skeleton is None:
            yield _axes("XSTART", joints[0], None if turned is None else float(turned[0]))
        else:
            if not skeleton.process.home.controller_name:
                yield _axes("XPARK", *skeleton.home_deg)
            if skeleton.probe_deg is not None:
                yield _axes("XPROBE", *skeleton.probe_deg)
            yield _axes("XSTART", *skeleton.start_deg)
            there = status_and_turn(self.cell, skeleton.retract_joints[None]).tolist()[0]
            yield _position("XRETRACT", frames(*skeleton.retracted)[0], there, external[-1])
        for i in range(0 if skeleton else 1, len(targets)):
            yield _position(f"XP{i + 1}", targets[i], said[i], external[i])
        arcs = np.flatnonzero(moves.circular).tolist()
        vias = frames(moves.via_position_mm[arcs], moves.via_quaternion_wxyz[arcs])
        yield from (f"  DECL POS XV{i + 1}={via}" for i, via in zip(arcs, vias, strict=True))
        yield "ENDDAT"


def _signal(kind: str, name: str) -> str:
    """By its number, or by the name that the controller has declared (SIGNAL)."""
    return f"{kind}[{name}]" if name.isdigit() else name


def _axes(name: str, joints_deg: Float, turntable_deg: float | None) -> str:
    axes = ",".join(f"A{i} {angle:.4f}" for i, angle in enumerate((np.round(joints_deg, 4) + 0.0).tolist(), 1))
    external = "" if turntable_deg is None else f",E1 {round(turntable_deg, 4) + 0.0:.4f}"
    return f"  DECL E6AXIS {name}={{{axes}{external}}}"


def _position(name: str, frame: str, said: list[int], external: str) -> str:
    return f"  DECL E6POS {name}={{{frame[1:-1]},S {said[0]},T {said[1]}{external}}}"


def status_and_turn(cell: Cell, joints: Float) -> Int:
    """STATUS and TURN (n, 2) at joint angles (n, 6), rad."""
    behind, below, flipped = arm_sides(cell.chain, joints).T
    status = behind + 2 * ~below + 4 * flipped
    negative = np.round(joints / DEG, 3) < 0  # an axis at rest on 0 has no sign of its rounding
    return np.column_stack([status, negative @ (1 << np.arange(6))])


def euler_deg(quaternion_wxyz: Float) -> Float:
    """A, B, C (k, 3) in deg with R = Rz(A) Ry(B) Rx(C); where B is +-90 deg only A -+ C counts, and C is 0."""
    r = rotation_from_quaternion(quaternion_wxyz)
    cosine = np.hypot(r[:, 0, 0], r[:, 1, 0])
    level = cosine < 1e-9
    a = np.where(level, np.arctan2(-r[:, 0, 1], r[:, 1, 1]), np.arctan2(r[:, 1, 0], r[:, 0, 0]))
    b = np.arctan2(-r[:, 2, 0], cosine)
    c = np.where(level, 0.0, np.arctan2(r[:, 2, 1], r[:, 2, 2]))
    return np.stack([a, b, c], axis=1) / DEG


def frames(position_mm: Float, quaternion_wxyz: Float) -> list[str]:
    """Poses (k, 3), (k, 4) as aggregates of KRL; 6 decimals of a degree are below 0.00001 deg."""
    values = np.concatenate([np.round(position_mm, 4), np.round(euler_deg(quaternion_wxyz), 6)], axis=1) + 0.0
    return [f"{{X {x:.4f},Y {y:.4f},Z {z:.4f},A {a:.6f},B {b:.6f},C {c:.6f}}}" for x, y, z, a, b, c in values.tolist()]


def frame(position_mm: Float, quaternion_wxyz: Float) -> str:
    """One pose."""
    return frames(position_mm[None], quaternion_wxyz[None])[0]


# The reader.


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
        found = self.lines.take(shapes, "a statement of this part of KRL (see workbench.program.krl)")
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
