"""Returns beside the root face beyond its lower end: those that run as it does, and those that do not."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Check
from workbench.checks.levels import one_level, step_check

FRAMES, PITCH_MM, NOISE_MM = 20, 0.05, 0.003
BEVEL, FACE = 40, 40  # columns
LOOKED_AT = 40
LEVEL = [(np.array([0.5, 0.8]), np.array([1.01, 1.04]))]  # along and across, of the returns next to a face's end


def told(
    off_mm: float = 1.0,
    *,
    lean: float = 0.0,
    gap: int = 4,
    count: int = 20,
    frames: int = FRAMES,
    mirrored: bool = False,
    lost: int = 0,
    wide_mm: float = 3.0,
) -> tuple[Check, Check]:
    """Of a root face at 20 deg, and beyond its end and a gap of columns a run so far beside it in most frames."""
    rng = np.random.default_rng(2)
    along = PITCH_MM * np.arange(BEVEL + FACE + 80)
    across = np.where(along < along[BEVEL], along - along[BEVEL], 0.0) + rng.normal(0.0, NOISE_MM, (frames, along.size))
    keep = np.zeros(across.shape, bool)
    keep[:, : BEVEL + FACE] = True
    begin = BEVEL + FACE + gap
    run = np.arange(begin, begin + count)
    across[:, run] += off_mm + lean * (along[run] - along[begin])
    keep[lost:, run] = True
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    x, z = c * along - s * across, s * along + c * across
    labels = np.zeros(keep.shape, np.uint8)
    labels[:, :BEVEL], labels[:, BEVEL : BEVEL + FACE] = BEVEL_FACE, ROOT_FACE
    order = slice(None, None, -1 if mirrored else 1)
    cloud: Any = SimpleNamespace(
        x_mm=x[:, order].astype(np.float32), z_mm=z[:, order].astype(np.float32), keep=keep[:, order].copy()
    )
    return step_check(cloud, labels[:, order].copy(), wide_mm)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("off_mm", [0.1, -0.1, 1.0, -2.9])
def test_what_runs_beside_the_face_is_told_and_how_far(off_mm: float, mirrored: bool) -> None:
    found, behind = told(off_mm, mirrored=mirrored)
    assert behind.value == 0.0
    assert found.value == 1.0
    assert not found.passed
    told_mm = re.match(r"in 100 % of the frames returns run parallel to the root face, (\S+) mm beside", found.finding)
    assert told_mm is not None
    assert float(told_mm[1]) == pytest.approx(abs(off_mm), abs=0.01)


def test_what_runs_farther_behind_than_the_face_is_wide_is_another_body() -> None:
    step, behind = told(-2.9, wide_mm=2.0)
    assert step.passed
    assert behind.passed
    assert behind.value == pytest.approx(2.9, abs=0.01)


def test_its_share_is_that_of_the_frames() -> None:
    assert told(lost=5)[0].value == pytest.approx(0.75)
    assert told(lost=FRAMES)[0].value == 0.0


@pytest.mark.parametrize(
    ("of", "share"),
    [
        ({"off_mm": 0.02}, 0.0),  # the face itself, behind lost returns
        ({"off_mm": 3.1}, 0.0),  # far beside it
        ({"gap": 60, "count": 4}, 0.0),  # beyond the columns that count
        ({"gap": 57, "count": 4}, 1.0),  # but for three, which are no run and yet on one level
        ({"gap": 50, "count": 4}, 1.0),
        ({"lean": 0.12}, 1.0),
        ({"lean": 0.3}, 0.0),  # a rounded edge falls off
        ({"count": 3, "off_mm": 0.2}, 0.0),  # three returns are no run, and so near the face no level
    ],
)
def test_what_counts_as_a_run(of: dict[str, Any], share: float) -> None:
    assert told(**of)[0].value == share


def test_two_returns_a_frame_on_one_level_are_told_too() -> None:
    found, _ = told(off_mm=1.02, count=2)
    assert found.value == 1.0
    assert "a table or a strip right below" in found.finding  # which two returns a frame show as a level


@pytest.mark.parametrize(("frames", "judged"), [(3, False), (4, True)])
def test_few_frames_judge_nothing(frames: int, judged: bool) -> None:
    assert (told(frames=frames)[0].value is not None) is judged


def test_returns_on_one_level_beside_a_face_are_told_by_their_share_and_height() -> None:
    share, height = one_level(LEVEL * 30, LOOKED_AT)
    assert share == pytest.approx(30 / LOOKED_AT)
    assert height == pytest.approx(1.04, abs=0.05)
    below = [(away, -across) for away, across in LEVEL]
    assert one_level(below * 30, LOOKED_AT) == pytest.approx((share, height), abs=0.06)


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ([], 0.0),
        (LEVEL * 1, 0.0),  # two returns
        (LEVEL * 2, 2 / LOOKED_AT),
        ([(np.array([0.2, 0.5]), np.array([0.1, 1.0]))] * 30, 0.0),  # the face falls off
        ([(np.array([0.05, 0.10]), np.array([1.0, 1.0]))] * 30, 0.0),  # at the end itself
        ([(np.array([3.2, 3.4]), np.array([1.0, 1.0]))] * 30, 0.0),  # far along
        ([(np.array([0.5, 0.8]), np.array([3.2, 3.2]))] * 30, 0.0),  # far across
        ([(np.array([0.5, 0.8, 0.9]), np.array([2.0, 1.0, 1.0]))] * 30, 30 / LOOKED_AT),
        ([(np.array([0.5]), np.array([1.0 + 0.01 * k])) for k in range(40)], 0.0),  # as many right beside it
    ],
)
def test_what_stands_on_no_level_is_another_surface(ends: list, told: float) -> None:  # type: ignore[type-arg]
    assert one_level(ends, LOOKED_AT)[0] == pytest.approx(told)


def test_a_level_that_leans_is_another_surface() -> None:
    level, leaning = (
        [(np.array([0.2 + 0.01 * k]), np.array([1.02 + lean * 0.01 * k])) for k in range(30)] for lean in (0.1, 0.25)
    )
    assert one_level(level, LOOKED_AT)[0] > 0.7
    assert one_level(leaning, LOOKED_AT)[0] == 0.0


@pytest.mark.parametrize("height_mm", np.arange(0.31, 1.0, 0.039).round(3))
def test_a_level_is_found_at_any_height_however_even(height_mm: float) -> None:
    """Returns that scatter less than the steps in which levels are sought lay beside all of them."""
    rng = np.random.default_rng(4)
    ends = [(np.array([0.33, 0.36]), height_mm + rng.normal(0.0, 0.001, 2)) for _ in range(LOOKED_AT)]
    share, height = one_level(ends, LOOKED_AT)
    assert share == 1.0
    assert height == pytest.approx(height_mm, abs=0.06)
