"""KRL, KUKA's language: the path as `.src` (moves) and `.dat` (targets).

(KUKA System Software, Operating and Programming Instructions for System Integrators.) Targets are E6POS in $BASE: X, Y,
Z in mm, and R = Rz(A) Ry(B) Rx(C) with A, B, C in deg; STATUS (S) and TURN (T) of the robot's posture; E1, the
turntable, in deg; E1 and E2 are tilt and turntable. The program begins with PTP to the first posture (E6AXIS), as KRL
asks. Feeds are $VEL.CP in m/s. Circular moves turn the tool in the frame of the base ($ORI_TYPE = #VAR, $CIRC_TYPE =
#BASE), as `path.simplify` assumes. With C_DIS the next move blends in $APO.CDIS mm before the target. STATUS: bit 0,
the wrist's centre is behind axis 1; bit 1, the elbow is up; bit 2, A5 is negative. TURN: bit i, axis i + 1 is negative.
All events stop the advance run; WAIT FOR waits without end; feeds are limited where they are written.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.artefacts import EventKind, ProgramMoves, ProgramTool
from workbench.dialect import rounded_feeds
from workbench.language import NAME, NUMBER, Language, reading, row
from workbench.program.reading import Reading, euler_pose, euler_rows, numbers_in, one_file, one_or_all
from workbench.program.skeleton import JOINT_PERCENT, SWITCHED, CellDialect, check_words, numbered, tidy
from workbench.robot.cell_model import Cell
from workbench.robot.wrist import arm_sides
from workbench.units import DEG, Float, Int

FRAME = "{{X {frame[0]:.4f},Y {frame[1]:.4f},Z {frame[2]:.4f},A {frame[3]:.6f},B {frame[4]:.6f},C {frame[5]:.6f}}}"
LOAD = "{{M {mass:g},CM {{X {at[0]:.4f},Y {at[1]:.4f},Z {at[2]:.4f},A 0.0,B 0.0,C 0.0}},J {{X 0.0,Y 0.0,Z 0.0}}}}"
BODY = ("straight", "circular", "feed", "axes", *SWITCHED)
SOURCE = Language(
    forms={
        "header": "{header}",
        "begin": "DEF {name} ( )",
        "modes": """  BAS (#INITMOV,0)
  BAS (#VEL_PTP,{percent:d})
  $TOOL={tool}
  $LOAD={load}
  $BASE={base}
  $IPO_MODE=#BASE
  $ORI_TYPE=#VAR
  $CIRC_TYPE=#BASE
  $APO.CDIS={zone:g}""",
        "feed": "  $VEL.CP={feed:.9g}",
        "axes": "  PTP {target}",
        "straight": "  LIN {target}{blend}",
        "circular": "  CIRC {via},{target}{blend}",
        "switch_on": "  {signal}=TRUE",
        "switch_off": "  {signal}=FALSE",
        "wait_speed": "  WAIT FOR {signal}",
        "wait_time": "  WAIT SEC {seconds}",
        "stop": "  HALT",
        "restart": "  {value}:",
        "hook": "  {value} ( )",
        "end": "END",
    },
    order={"": ("header", "begin"), "begin": ("modes", "hook"), "modes": BODY, "restart": ("modes",), "end": ()},
    kinds={
        "header": r"&[^\r\n]*",
        "tool": rf"TOOL_DATA\[[0-9]+\]|{reading(FRAME)}",
        "base": rf"BASE_DATA\[[0-9]+\]|{reading(FRAME)}",
        "load": rf"LOAD_DATA\[[0-9]+\]|{reading(LOAD)}",
        "blend": "(?: C_DIS)?",
        "signal": rf"\$(?:IN|OUT)\[[0-9]+\]|{NAME}",
        "seconds": NUMBER,
    },
    comment=";",
)
DATA = Language(
    forms={
        "header": "{header}",
        "begin": "DEFDAT {name}",
        "axes": f"  DECL E6AXIS {{name}}={{{{{row([f'A{i} ' for i in range(1, 7)], 'angle', '.4f')}{{e1}}}}}}",
        "target": f"  DECL E6POS {{name}}={FRAME[:-2]},S {{status:d}},T {{turn:d}}{{e1}}}}}}",
        "via": f"  DECL POS {{name}}={FRAME}",
        "end": "ENDDAT",
    },
    order={"": ("header", "begin"), "begin": ("target", "axes", "via", "end"), "end": ()},
    kinds={"header": r"&[^\r\n]*", "e1": f"(?:,E1 {NUMBER}(?:,E2 {NUMBER})?)?"},
    comment=";",
)
NAMES = {"home": "XPARK", "probe": "XPROBE", "start": "XSTART", "first": "XP1", "retract": "XRETRACT"}


class _Data(Reading):
    """The data list: declared positions, by name; type and what it says."""

    language = DATA

    def __init__(self) -> None:
        super().__init__()
        self.declared: dict[str, tuple[str, Any]] = {}

    def _declare(self, name: str, value: Any) -> None:
        if name in self.declared:
            self.refuse("a name that is not taken", name)
        self.declared[name] = (self.said.form, value)

    def axes(self, name: str, angle: list[float], e1: str) -> None:
        self._declare(name, (np.array(angle) * DEG, _turntable(e1)))

    def target(self, name: str, frame: list[float], status: int, turn: int, e1: str) -> None:
        self._declare(name, (euler_pose(frame[:3], frame[3:]), (status, turn), _turntable(e1)))

    def via(self, name: str, frame: list[float]) -> None:
        self._declare(name, euler_pose(frame[:3], frame[3:]))


def _turntable(e1: str) -> Float | float | None:
    """E1 in rad, or E1 and E2 (2,); None: it is not commanded."""
    return one_or_all([float(one.split()[1]) * DEG for one in e1.split(",")[1:]])


class Source(Reading):
    """The moves, `.src`, with the data list, `.dat`."""

    language, dialect, suffix = SOURCE, "kuka", ".src"
    speed = zone = percent = 0.0

    def program(self, files: Mapping[str, str]) -> ProgramMoves:
        """The program of both files."""
        one_file(files, self.suffix)
        data = _Data()
        data.run(*one_file(files, ".dat"))
        self.declared, self.labels = data.declared, {*data.declared}
        return super().program(files)

    def modes(self, percent: int, tool: str, load: str, base: str, zone: float) -> None:
        self.percent, self.zone = percent, zone
        at, place, weight = (numbers_in(one) if one[0] == "{" else None for one in (tool, base, load))
        self.tool, self.work_object = tool if at is None else "$TOOL", base if place is None else "$BASE"
        mass, centre = (None, None) if weight is None else (weight[0], np.array(weight[1:4]))
        self.tools[self.tool] = ProgramTool(None if at is None else euler_pose(at[:3], at[3:]), mass, centre)
        self.objects[self.work_object] = None if place is None else euler_pose(place[:3], place[3:])

    def feed(self, feed: float) -> None:
        self.speed = 1000 * feed

    def axes(self, target: str) -> None:
        if target == self.home and target not in self.declared:
            self.by_joints(self.percent / 100, None, place=target)
        else:
            self.by_joints(self.percent / 100, *self._position(target, "axes"))

    def straight(self, target: str, blend: str, via: str = "") -> None:
        pose, configuration, turntable = self._position(target, "target")
        over = self._position(via, "via") if via else None
        zone = self.zone if blend else 0.0
        self.in_space(pose, over, self.speed, zone, turntable=turntable, configuration=configuration)

    circular = straight

    def use(self, use: str, name: str) -> None:
        if name.startswith("$IN" if use in "10" else "$OUT"):
            self.refuse("an output to switch, or an input to wait for", name)
        super().use(use, re.sub(r"\$\w+\[|\]", "", name))

    def _position(self, name: str, kind: str) -> Any:
        declared, value = self.declared.get(name, ("nothing", None))
        if declared != kind:
            self.refuse("a name that the data list declares, and of the type that this statement takes", name)
        return value


@dataclass
class Krl(CellDialect):
    """The dialect of KUKA's controllers."""

    language, reader, note = SOURCE, Source, "  ; "

    def __post_init__(self) -> None:
        """Refuse names that are none of the controller's."""
        named = ("tool", "TOOL_DATA", self.job.tool_name), ("work_object", "BASE_DATA", self.job.work_object_name)
        for part, kind, name in named:
            if name is not None:
                numbered(self.cell, "KUKA", part, kind, name)
        check_words(self.cell, "KUKA", signals="both")

    def fields(self, kind: EventKind, value: str) -> dict[str, Any]:
        """A signal by its number, or by the name that the controller has declared (SIGNAL)."""
        signal = f"{'$IN' if kind == 'wait_speed' else '$OUT'}[{value}]" if value.isdigit() else value
        return {"value": value.upper() if kind == "restart" else value, "seconds": value, "signal": signal}

    @functools.cached_property
    def feeds(self) -> list[float]:
        """Of the moves, mm/s."""
        rounded: list[float] = rounded_feeds(self.limited_mm_s).tolist()
        return rounded

    def again(self) -> list[str]:
        """All that holds until it is said otherwise."""
        job, name = self.job, self.job.tool_name
        load = LOAD.format(mass=job.tool.mass_kg, at=job.tool.centre_of_gravity_mm)
        return self.say(
            "modes",
            percent=JOINT_PERCENT,
            tool=name or _frame(job.tool_centre_point_mm, job.tool.quaternion_wxyz),
            load=load if name is None else name.replace("TOOL", "LOAD"),
            base=job.work_object_name or _frame(*job.work_object),
            zone=job.zone_mm,
        )

    def head(self) -> list[str]:
        """Remarks, tool, load, base and how to move."""
        begin = ["&ACCESS RVP", *self.say("begin", name=self.job.name)]
        return [*begin, *map(self.remark, self.job.remarks), *self.events("first"), *self.again()]

    @functools.cached_property
    def ends(self) -> list[dict[str, Any]]:
        """Whether the next move blends in."""
        return [{"blend": " C_DIS" if blends else ""} for blends in self.blends]

    def place(self, where: int | str) -> dict[str, Any]:
        """By names out of the data list."""
        if isinstance(where, int):
            return {"via": f"XV{where + 1}", "target": f"XP{where + 1}"}
        return {"target": NAMES[where]}

    def straight_to(self, where: str) -> list[str]:
        """LIN; the feed of the retract is that of the last move."""
        return [*(self._velocity(0) if where == "first" else []), *super().straight_to(where)]

    def move(self, i: int) -> list[str]:
        """LIN or CIRC, behind its feed if it is another than before."""
        changed = i == 1 or bool(self.layer(i)) or self.feeds[i] != self.feeds[i - 1]
        return [*(self._velocity(i) if changed else []), *super().move(i)]

    def _velocity(self, i: int) -> list[str]:
        return self.say("feed", feed=self.feeds[i] / 1000)

    def configuration(self, joints: Float, cell: Cell) -> tuple[int, ...]:
        """STATUS and TURN of a posture (6,), rad."""
        return tuple(status_and_turn(cell, joints[None])[0].tolist())

    def documents(self, text: str) -> dict[str, str]:
        """The moves, and the data list with their targets."""
        name = self.job.name
        return {f"{name}.src": text, f"{name}.dat": "\n".join([*self._data(), ""])}

    def _data(self) -> Iterator[str]:
        """The data list: postures, targets, middles of arcs."""
        moves, turntable, skeleton = self.job.moves, self.job.turntable_deg, self.skeleton
        assert moves.joints_deg is not None
        external = [_e1(None)] * len(moves.layer) if turntable is None else [_e1(angle) for angle in turntable]
        yield from ("&ACCESS RVP", DATA.say("begin", name=self.job.name))
        targets = _frames(moves.position_mm, moves.quaternion_wxyz)
        said = status_and_turn(self.cell, moves.joints_deg * DEG).tolist()
        for where, (angles, table) in self.postures.items():
            yield DATA.say("axes", name=NAMES[where], angle=tidy(angles, 4), e1=_e1(table))
        if skeleton is not None:
            there = status_and_turn(self.cell, skeleton.retract_joints[None]).tolist()[0]
            yield _position("XRETRACT", _frames(*skeleton.retracted)[0], there, external[-1])
        for i in range(0 if skeleton else 1, len(targets)):
            yield _position(f"XP{i + 1}", targets[i], said[i], external[i])
        arcs = np.flatnonzero(moves.circular).tolist()
        vias = _frames(moves.via_position_mm[arcs], moves.via_quaternion_wxyz[arcs])
        yield from (DATA.say("via", name=f"XV{i + 1}", frame=via) for i, via in zip(arcs, vias, strict=True))
        yield "ENDDAT"


def _frames(position_mm: Float, quaternion_wxyz: Float) -> list[list[float]]:
    """X, Y, Z, A, B, C of poses (k, 3), (k, 4); 6 decimals of a degree are below 0.00001 deg."""
    return euler_rows(position_mm, quaternion_wxyz, 4, 6)


def _frame(position_mm: Float, quaternion_wxyz: Float) -> str:
    return FRAME.format(frame=_frames(position_mm[None], quaternion_wxyz[None])[0])


def _e1(turntable_deg: Float | None) -> str:
    """What an aggregate does not name stays where it is."""
    values = [] if turntable_deg is None else tidy(np.atleast_1d(turntable_deg), 4)
    return "".join(f",E{i} {value:.4f}" for i, value in enumerate(values, 1))


def _position(name: str, frame: list[float], said: list[int], external: str) -> str:
    return DATA.say("target", name=name, frame=frame, status=said[0], turn=said[1], e1=external)


def status_and_turn(cell: Cell, joints: Float) -> Int:
    """STATUS and TURN (n, 2) at joint angles (n, 6), rad."""
    behind, below, flipped = arm_sides(cell.chain, joints).T
    status = behind + 2 * ~below + 4 * flipped
    negative = np.round(joints / DEG, 3) < 0  # an axis at rest on 0 has no sign of its rounding
    return np.column_stack([status, negative @ (1 << np.arange(6))])
