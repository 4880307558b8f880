"""What a run rests on and decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


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
    loosened: tuple[str, ...] = ()  # checks that a parameter made weaker than the rule: programs say so
    unchecked: tuple[str, ...] = ()  # what nothing in the run could look at: programs say so
    warnings: tuple[str, ...] = ()  # what the pipeline lets through that the default would not

    @property
    def clean(self) -> bool:
        """Passed, with every check in full force."""
        return self.passed and not self.loosened

    @property
    def cause(self) -> str:
        """Why the exit status is not 0; '' where it is."""
        return "; ".join(self.loosened) if self.passed else self.reason


class RobotCell:
    """What a pipeline has where it knows the robot: then no program is written without postures."""

    __slots__ = ()
