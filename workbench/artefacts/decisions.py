"""What a run rests on and decides."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.artefacts.inspections import Verdict
    from workbench.artefacts.paths import Moves
    from workbench.artefacts.programs import Judgement, ProgramMoves


NOT_CHECKED = "NOT CHECKED: "  # begins what of `Gate.loosened` was not looked at


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
