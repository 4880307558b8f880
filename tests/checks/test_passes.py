"""By how much passes disagree where both saw a face; two that agree, or do not: tests/checks/test_judge.py."""

import numpy as np
import pytest

from workbench.checks.passes import disagreement_mm
from workbench.units import Float

ROOF = np.radians([0.0, -40.0])  # of two faces that meet at x = 0, against x
X = np.arange(-20.0, 20.0, 0.1)
FRAMES = 21


def passes(
    off_mm: tuple[float, float, float] = (0.0, 0.0, 0.0), width: int = X.size
) -> tuple[Float, Float, dict[int, Float], Float]:
    """Two passes over the roof, the second the other way round, and off by that in the base."""
    pose = np.tile(np.eye(4), (2 * FRAMES, 1, 1))
    pose[:FRAMES, 1, 3] = np.linspace(0.0, 40.0, FRAMES)
    pose[FRAMES:, 1, 3] = np.linspace(41.0, -1.0, FRAMES)
    depth = 100.0 + np.where(X < 0.0, np.tan(ROOF[0]), np.tan(ROOF[1])) * X
    x, z = np.tile(X, (2 * FRAMES, 1)), np.tile(depth, (2 * FRAMES, 1))
    pose[FRAMES:, :3, 3] += off_mm
    z[:, width:] = np.nan
    return x, z, {0: np.arange(FRAMES), 1: np.arange(FRAMES, 2 * FRAMES)}, pose


def test_the_worst_pair_of_passes_counts() -> None:
    x, z, frames, pose = passes((0.0, 0.0, 0.5))
    third = np.arange(2 * FRAMES, 3 * FRAMES)
    x, z, pose = (np.concatenate([of, of[:FRAMES]]) for of in (x, z, pose))
    pose[third, 2, 3] += 2.0
    assert disagreement_mm(x, z, {**frames, 2: third}, pose) == pytest.approx(1.5, abs=0.03)


def test_a_face_that_lies_far_off_is_another_one() -> None:
    assert disagreement_mm(*passes((0.0, 0.0, 11.0))) == pytest.approx(11.0, abs=0.1)
    assert np.isnan(disagreement_mm(*passes((0.0, 0.0, 20.0))))


@pytest.mark.parametrize(("width", "seen"), [(19, False), (40, True)])
def test_passes_of_few_returns_and_one_pass_alone_tell_nothing(width: int, seen: bool) -> None:
    assert np.isfinite(disagreement_mm(*passes(width=width))) == seen
    x, z, frames, pose = passes()
    assert np.isnan(disagreement_mm(x, z, {0: frames[0]}, pose))
    pose[FRAMES:, 1, 3] += 100.0  # beside the first pass
    assert np.isnan(disagreement_mm(x, z, frames, pose))
