"""Ends of what is seen that stay in a column, or go in steps: the sensor's window, not the part."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from workbench.checks import judge_recording
from workbench.checks.window import end_step_check, hidden_columns
from workbench.scan import read
from workbench.units import Bool


def seen(first: list[int], last: list[int], columns: int = 100) -> Bool:
    """Frames that show all from a column to another."""
    at = np.arange(columns)
    return np.array([(at >= low) & (at <= high) for low, high in zip(first, last, strict=True)])


def test_frames_that_show_nothing_tell_of_no_end() -> None:
    assert hidden_columns(np.zeros((5, 100), bool)) == 0


@pytest.mark.parametrize(("staying", "hidden"), [(4, 3), (3, 0)])
def test_as_much_may_be_hidden_as_is_blind_elsewhere_where_an_end_stays(staying: int, hidden: int) -> None:
    frames = seen([10] * staying + list(range(11, 21 - staying)), list(range(80, 90)))
    frames[:, 40:43] = False
    empty = np.zeros((3, 100), bool)
    for shown in (frames, frames[:, ::-1], np.concatenate([frames, empty])):
        assert hidden_columns(shown) == hidden
    assert hidden_columns(frames[:, 10:90]) == 0  # the grid's own ends


def test_a_column_that_returns_now_and_then_is_not_blind() -> None:
    """Few frames alone would not show it: beside a robot that follows its edge well, 11 such put u at 0.43 mm."""
    recording = read(recording=Path("data/synthetic/milled_edge.h5"))
    z = recording.z_mm.copy()
    found = []
    for returns in (slice(0, 0), slice(1, 4)):  # in no frame, in three
        z[:, 300:304] = np.nan
        z[returns, 300:304] = recording.z_mm[returns, 300:304]
        checks = {one.name: one.value for one in judge_recording(dataclasses.replace(recording, z_mm=z))}
        found.append(checks["blind_columns"])
    assert found == [4, 0]


@pytest.mark.parametrize("step", [8, 16, 32])
def test_a_face_that_ends_at_every_nth_column_alone_is_cut_by_a_window(step: int) -> None:
    columns = 5 + step * np.repeat([3, 4, 5], 10)
    found = end_step_check(columns)
    assert found.value == step
    assert f"every {step}th column" in found.finding
    stray = np.concatenate([columns, [1, 2, 3, 6]])  # a few elsewhere
    assert end_step_check(stray).value == step


@pytest.mark.parametrize(
    "columns",
    [
        5 + 32 * np.repeat([3, 4], 15),  # two places alone may be the part's
        5 + 32 * np.repeat([3, 4, 5], 6),  # few frames
        np.concatenate([5 + 32 * np.repeat([3, 4, 5], 10), np.arange(14)]),  # a third elsewhere
        5 + 32 * np.repeat([3, 4, 5], [29, 29, 2]),  # the third place is an accident
        np.arange(100, 140),
    ],
)
def test_a_face_that_ends_anywhere_or_in_two_places_is_not(columns: np.ndarray) -> None:
    found = end_step_check(columns)
    assert found.value == 0
    assert found.passed
    assert found.finding == "the face ends in any column"
