"""Returns beside the root face beyond its lower end: those that run as it does, and those that do not."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Check
from workbench.checks.levels import beside_check

FRAMES, PITCH_MM, NOISE_MM = 20, 0.05, 0.003
BEVEL, FACE = 40, 40  # columns


def told(
    off_mm: float = 1.0,
    *,
    lean: float = 0.0,
    gap: int = 4,
    count: int = 20,
    frames: int = FRAMES,
    mirrored: bool = False,
    lost: int = 0,
) -> Check:
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
    return beside_check(cloud, labels[:, order].copy())


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("off_mm", [0.1, -0.1, 1.0, -2.9])
def test_what_runs_beside_the_face_is_told_and_how_far(off_mm: float, mirrored: bool) -> None:
    found = told(off_mm, mirrored=mirrored)
    assert found.value == 1.0
    assert not found.passed
    told_mm = re.match(r"in 100 % of the frames returns run parallel to the root face, (\S+) mm beside", found.finding)
    assert told_mm is not None
    assert float(told_mm[1]) == pytest.approx(abs(off_mm), abs=0.01)


def test_its_share_is_that_of_the_frames() -> None:
    assert told(lost=5).value == pytest.approx(0.75)
    assert told(lost=FRAMES).value == 0.0


@pytest.mark.parametrize(
    ("of", "share"),
    [
        ({"off_mm": 0.02}, 0.0),  # the face itself, behind lost returns
        ({"off_mm": 3.1}, 0.0),  # far beside it
        ({"gap": 57, "count": 4}, 0.0),  # beyond the columns that count, but for three
        ({"gap": 50, "count": 4}, 1.0),
        ({"lean": 0.12}, 1.0),
        ({"lean": 0.3}, 0.0),  # a rounded edge falls off
        ({"count": 3, "off_mm": 0.2}, 0.0),  # three returns are no run, and so near the face no level
    ],
)
def test_what_counts_as_a_run(of: dict[str, Any], share: float) -> None:
    assert told(**of).value == share


def test_two_returns_a_frame_on_one_level_are_told_too() -> None:
    found = told(off_mm=1.02, count=2)
    assert found.value == 1.0
    assert "1" in found.finding


@pytest.mark.parametrize(("frames", "judged"), [(3, False), (4, True)])
def test_few_frames_judge_nothing(frames: int, judged: bool) -> None:
    assert (told(frames=frames).value is not None) is judged
