"""What a run rests on and decides; a robot program as read back, and what the judge said of it.

Lengths in mm, angles in rad, times in s. A program is judged from these values alone, never from what it was made of.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from workbench.units import Float, Shaped

if TYPE_CHECKING:
    from workbench.artefacts.evidence import Verdict
    from workbench.artefacts.paths import Moves


MoveKind = Literal["J", "L", "C"]
EventKind = Literal[
    "spindle_on",
    "spindle_off",
    "wait_speed",
    "wait_time",
    "coolant_on",
    "coolant_off",
    "activate_axis",
    "hook",
    "stop",
    "restart",
    "feed_limits",
]


@dataclass(frozen=True, slots=True, eq=False)
class ProgramTool:
    """A tool that the program declares, or one of the controller's by its name alone."""

    flange_from_tool: Shaped[Float, "4 4"] | None  # None: measured on the controller, the cell file knows it by name
    mass_kg: float | None = None
    centre_of_gravity_mm: Shaped[Float, " 3"] | None = None  # in the flange


@dataclass(frozen=True, slots=True, eq=False)
class ProgramMove:
    """One move from where the one before it ended. J: the joints in step; L: straight; C: circular over `via`.

    A target is joint angles or a pose. L and C turn the tool by the shortest rotation, in step with the length of path.
    """

    line: int  # of the file, from 1
    kind: MoveKind
    tool: str  # key of `ProgramMoves.tools`
    work_object: str  # key of `ProgramMoves.work_objects`
    joints: Shaped[Float, " 6"] | None = None  # the controller's angles as the cell counts them
    pose: Shaped[Float, "4 4"] | None = None  # workobject_from_tool
    via: Shaped[Float, "4 4"] | None = None  # of C, likewise
    feed_mm_s: float | None = None  # of the tool centre point; None: joints at `joint_speed`
    joint_speed: float = 1.0  # of J: share of the largest speeds, 0 to 1
    zone_mm: float = 0.0  # from the target, where the next move may blend in; 0: the target is reached
    # rad, of the external axis at the target, of several from the base outwards (e,); None: it is not commanded
    turntable: Float | float | None = None
    configuration: tuple[int, ...] | None = None  # as the dialect counts it; None: the program does not say
    place: str = ""  # the joint target on the controller that J goes to, where the program has its name alone
    time_s: float | None = None  # of a trajectory: when the target is reached, from the start of the program
    layer: int | None = None  # of a trajectory: that the target belongs to, 0 a travel; None: the program does not say


@dataclass(frozen=True, slots=True, eq=False)
class ProgramEvent:
    """What happens between moves."""

    line: int
    before: int  # index of the move that comes next; the number of moves: after the last
    kind: EventKind
    value: str = ""  # the signal, routine, axis, label or number, as written


@dataclass(frozen=True, slots=True, eq=False)
class ProgramMoves:
    """One program. The robot stands at its first target after its first move, which must give joint angles."""

    dialect: str
    name: str  # of its file, for messages
    moves: tuple[ProgramMove, ...]
    tools: Mapping[str, ProgramTool]
    work_objects: Mapping[str, Float | None]  # base_from_workobject (4, 4); None: measured on the controller
    events: tuple[ProgramEvent, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Violation:
    """A place of a program that must not be run."""

    line: int  # of the program's file
    arc_length_mm: float  # of the tool's way, from the first target
    # collision, limit, singular, speed, acceleration, deviation, feed, configuration, unreachable, unsteady, process
    kind: str
    finding: str  # in words, with the pair, the joint and the numbers


@dataclass(frozen=True, slots=True, eq=False)
class Nearest:
    """Where two bodies that must not touch come nearest to each other, as measured between their shapes."""

    distance_mm: float
    pair: tuple[str, str]
    line: int  # of the program's file
    arc_length_mm: float  # of the tool's way, from the first target


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """What came of driving a program through its cell. Least margins are over the whole way, not the targets alone."""

    program: ProgramMoves
    violations: tuple[Violation, ...]
    unchecked: tuple[str, ...]  # what could not be looked at: stands as NOT CHECKED in the program's head
    length_mm: float
    time_s: float
    postures: int  # that were looked at
    clearance_mm: float  # least, proven between the postures too; inf: nothing could touch
    clearance_pair: tuple[str, str] | None
    limit_margin: float  # rad, least, of any joint and the turntable
    wrist: float  # rad, least |sine of the wrist's angle| as an angle; pi/2 where the robot has no such wrist
    condition: (
        float  # largest of linear moves, of the Jacobian with lengths in units of the robot's own; NaN: there are none
    )
    speed_share: float  # largest joint speed, as a share of its limit
    deviation_mm: float  # largest, of the tool from the planned path
    # arc_length_mm, clearance_mm, limit_margin, wrist, condition, (n,) each; the last two NaN in joint moves
    along: Mapping[str, Float]
    nearest: Nearest | None = None  # of the postures that were looked at; None: nothing could touch
    # at the places of the first look, in their order: joints (n, 6) and turntable, rad; time_s, line, mm_s, (n,) each
    driven: Mapping[str, Float] = field(default_factory=dict)
    stops: int = 0  # targets between two moves at which the tool stands still
    stops_counted: bool = False  # their time is in `time_s`: the cell file says what one costs

    @property
    def passed(self) -> bool:
        """Whether a robot may run it."""
        return not self.violations


NOT_CHECKED = "NOT CHECKED: "  # begins what of `Gate.loosened` was not looked at
SHAPE_ONLY = "SHAPE ONLY: "  # begins what of `Gate.loosened` says that nothing shows where the part stands
NO_PROGRAM = "no program for "  # likewise that a program was asked for, and none could be: of the path it says nothing


@dataclass(frozen=True, slots=True, eq=False)
class Provenance:
    """What a run rests on, for its report. The runner supplies it to a stage that asks for it."""

    title: str
    inputs: tuple[tuple[str, str, str], ...]  # name, path as given, SHA-256
    versions: Mapping[str, str]  # package -> version
    pipeline: Mapping[str, Any]  # as resolved
    seed: int


@dataclass(frozen=True, slots=True, eq=False)
class Gate:
    """The pipeline's decision: the exit status is 1 where `passed` is False, or where a check was loosened."""

    passed: bool
    reason: str
    loosened: tuple[str, ...] = ()  # checks made weaker than the rule, or not made (NOT CHECKED): programs say so
    unchecked: tuple[str, ...] = ()  # what nothing in the run could look at: programs say so
    warnings: tuple[str, ...] = ()  # what the pipeline lets through that the default would not

    @property
    def clean(self) -> bool:
        """Passed, with every check in full force."""
        return self.passed and not self.loosened

    @property
    def shape_only(self) -> bool:
        """Whether nothing shows where the part stands: a program then stops at a point for the operator, or is none."""
        return any(text.startswith(SHAPE_ONLY) for text in self.loosened)

    @property
    def only_place_open(self) -> bool:
        """Passed, with every check of the path in full force but that of where the part stands."""
        return self.passed and all(text.startswith((SHAPE_ONLY, NO_PROGRAM)) for text in self.loosened)

    @property
    def verdict(self) -> Verdict:
        """Of the report's first page: `pass` only where the exit status is 0."""
        return "fail" if not self.passed else "undecided" if self.loosened else "pass"

    @property
    def left_open(self) -> tuple[str, ...]:
        """What was not checked, or with less force than the rule; first what the exit status is 1 for."""
        return tuple(dict.fromkeys(text.removeprefix(NOT_CHECKED) for text in (*self.loosened, *self.unchecked)))

    @property
    def cause(self) -> str:
        """Why the exit status is not 0; '' where it is."""
        return "; ".join(self.loosened) if self.passed else self.reason


class RobotCell(ABC):
    """What a pipeline has where it knows the robot: only there programs are written, and they are judged in it."""

    __slots__ = ()
    unchecked: tuple[str, ...] = ()  # what its file does not say of it, so that nothing can look at it
    unseen: tuple[str, ...] = ()  # what stands in it and was not shown: programs say so

    @property
    def probes(self) -> bool:
        """Whether its programs stop at a point of the path, for the operator to see that it is there."""
        return False

    @abstractmethod
    def judge(
        self,
        program: ProgramMoves,
        moves: Moves,
        tolerance_mm: float,
        configuration: Callable[..., tuple[int, ...] | None],
    ) -> Judgement:
        """Drive a program, as read back from its file, through this cell.

        Args:
            program: as read back.
            moves: that it was written from: their path is what the tool must follow.
            tolerance_mm: by which it may leave that path.
            configuration: of joint angles (6,) in this cell, as the program's dialect counts it.
        """
        ...
