"""A stranger's dialect comes in by the door of plug-ins, and gets the same care as ours."""

from dataclasses import dataclass

import numpy as np
import pytest

from workbench.api import Cutter, Dialect, Layer, MillingTool, Moves, PathGate, ProgramJob, Toolpath, write_program
from workbench.artefacts import Part
from workbench.dialect import LONGEST_REMARK, plain, program_files, rounded_feeds


@dataclass
class Letters:
    """A language of letters."""

    job: ProgramJob

    def head(self):
        return [f"( {remark} )" for remark in self.job.remarks]

    def start(self):
        return [f"R {self.job.moves.position_mm[0][0]:g}"]

    def straight(self, i):
        return [f"L {self.job.moves.position_mm[i][0]:g}"]

    def circular(self, i):
        return [f"C {self.job.moves.via_position_mm[i][0]:g} {self.job.moves.position_mm[i][0]:g}"]

    def remark(self, text):
        return f"( {text} )"

    def foot(self):
        return ["END"]

    def documents(self, text):
        return {f"{self.job.name}.txt": text}


def job(part_id: str = "plate") -> ProgramJob:
    position = np.outer(np.arange(4.0), [1.0, 0.0, 0.0])
    q = np.tile([1.0, 0.0, 0.0, 0.0], (4, 1))
    via = np.full((4, 3), np.nan)
    via[2] = [1.5, 1.0, 0.0]
    layer = Layer(1, 0.0, np.arange(4.0), position, q, np.ones(4), np.ones(4, bool), np.ones(4, bool), np.ones(4))
    path = Toolpath(Cutter(), (layer,), (), 1.5, 40.0, 1.0, 1.0, 3.0, part=Part(part_id=part_id))
    moves = Moves(
        position,
        q,
        np.arange(4) == 2,
        via,
        q,
        np.ones(4),
        np.ones(4, bool),
        np.array([0, 1, 1, 0]),
        path,
        9,
        0.01,
        0.05,
    )
    return ProgramJob("Other", moves, MillingTool(np.zeros(3), q[0], 1.0, np.zeros(3)), 0.0)


def gate_of(dialect: Dialect, passed: bool) -> PathGate:
    return PathGate(passed, "", toolpath=dialect.job.moves.toolpath, tolerance_mm=0.05)


def test_a_program_is_head_moves_and_foot() -> None:
    dialect: Dialect = Letters(job("a\nL 99"))
    (name, text), *others = program_files(dialect, gate_of(dialect, True)).items()
    assert (name, others) == ("Other.txt", [])
    lines = text.splitlines()
    assert lines[-7:] == ["R 0", "( layer 1 )", "L 1", "C 1.5 2", "( travel )", "L 3", "END"]
    assert "( part: a?L 99 )" in lines


def test_a_rejected_path_gives_no_program() -> None:
    dialect = Letters(job())
    assert write_program(dialect, gate_of(dialect, False)).documents == ()


@pytest.mark.parametrize("text", ["a\nb", "a\r\u2028b", "!;%&$\\\"'`{}[]<>", "ü" * 200, "\x00\x1b[31m"])
def test_remarks_are_plain(text: str) -> None:
    made = plain(text)
    assert made.isascii()
    assert made.isprintable()
    assert len(made) <= LONGEST_REMARK
    assert not set("!;%&$\\\"'`{}[]<>") & set(made)


def test_feeds_have_three_digits() -> None:
    feeds = rounded_feeds(np.array([1.0, 1.23456, 19.996, 0.012345, 123.45, 0.3]))
    assert feeds.tolist() == pytest.approx([1.0, 1.23, 20.0, 0.0123, 123.0, 0.3], rel=1e-12)
