"""Burrs on a raw edge: where most frames show them, and by how far the edge may lie off where all do."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import ROOT_FACE, UNLABELLED
from workbench.edge.segment_raw import burred_u_mm, raw_burr_stations

FRAMES = 200
END = np.array([3.0, 90.0])  # of the face, in a profile


def scanned(burred: int, corners: int = 0, off_mm: float = 0.3) -> tuple[Any, Any]:
    """Frames of a face whose nearest return lies so far off its lower end; what stands nearer does not count."""
    along = np.arange(0.0, 5.0, 0.1)
    x = np.tile(END[0] + 0.6 * off_mm + along, (FRAMES, 1))
    z = np.tile(END[1] + 0.8 * off_mm + 0.5 * along, (FRAMES, 1))
    labels, keep = np.full(x.shape, ROOT_FACE, np.uint8), np.ones(x.shape, bool)
    x[:, -2:], z[:, -2:] = END
    labels[:, -2], keep[:, -1] = UNLABELLED, False
    number = np.arange(FRAMES)
    ends = SimpleNamespace(point=np.tile(END, (FRAMES, 1)), corner=number < corners, burred=number >= FRAMES - burred)
    return SimpleNamespace(x_mm=x, z_mm=z, keep=keep), SimpleNamespace(lower=ends, labels=labels, seen=number >= 0)


@pytest.mark.parametrize("off_mm", [0.1, 0.3])
def test_where_most_frames_are_burred_the_edge_lies_anywhere_up_to_the_last_return(off_mm: float) -> None:
    assert burred_u_mm(*scanned(FRAMES, off_mm=off_mm)) == pytest.approx(off_mm / np.sqrt(3.0))


@pytest.mark.parametrize(
    ("burred", "corners", "told"), [(99, 0, False), (100, 0, True), (79, 40, False), (80, 40, True)]
)
def test_half_of_the_frames_that_show_the_end_itself_count(burred: int, corners: int, told: bool) -> None:
    assert (burred_u_mm(*scanned(burred, corners)) > 0.0) is told


def test_frames_that_do_not_show_the_end_say_nothing() -> None:
    cloud, found = scanned(FRAMES)
    found.lower.point[: FRAMES // 2] = np.nan
    assert burred_u_mm(cloud, found) == pytest.approx(0.3 / np.sqrt(3.0))
    found.seen[:] = False
    assert burred_u_mm(cloud, found) == 0.0


def stations(lower: list[float], upper: list[float], clean: list[float]) -> list[int]:
    """Stations 0 to 20 mm at which a burr is told, of frames at those places."""
    s = np.array([*lower, *upper, *clean, np.nan])
    number = np.arange(s.size)
    low, high = number < len(lower), (number >= len(lower)) & (number < len(lower) + len(upper))
    low[-1] = True
    found = SimpleNamespace(lower=SimpleNamespace(burred=low), upper=SimpleNamespace(burred=high))
    return raw_burr_stations(found, SimpleNamespace(s_face=s), np.arange(21.0)).tolist()  # type: ignore[arg-type]


def test_a_burr_is_told_within_reach_of_its_frames() -> None:
    assert stations([10.0, 10.1], [], []) == [9, 10, 11]
    assert stations([], [10.3, 10.1], []) == [10, 11]
    assert stations([10.0, 10.1], [15.0, 15.1], []) == [9, 10, 11, 14, 15, 16]


def test_one_frame_is_no_burr_and_neither_are_fewer_than_half() -> None:
    assert stations([10.0], [], []) == []
    assert stations([10.0, 10.1], [], [10.2, 9.9]) == [9, 10, 11]
    assert stations([10.0, 10.1], [], [10.15, 9.9, 10.05]) == []
    assert stations([10.0], [10.1], []) == []  # of different edges
