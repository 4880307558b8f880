"""What cannot be determined is refused, and its direction named; sound recordings are not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.plugins.calibration.conftest import TRUE, cell, off_design, postures, recording
from workbench.api import InputError
from workbench.plugins.calibration import circles, hand_eye


def calibrated(rng: Any, made: Any, design: Any = TRUE) -> Any:
    rec = recording(rng, made, design)
    return hand_eye(circles(rec), rec)[1]


def same_orientation(rng: Any, turns: Any, centre: Any) -> Any:
    return np.repeat(turns[:1], len(turns), axis=0), centre


def one_axis(rng: Any, turns: Any, centre: Any) -> Any:
    axis = rng.normal(size=3)
    angles = rng.uniform(-0.6, 0.6, (len(turns), 1)) * axis / np.linalg.norm(axis)
    return (Rotation.from_rotvec(angles) * Rotation.from_matrix(turns[0])).as_matrix(), centre


def two_orientations(rng: Any, turns: Any, centre: Any) -> Any:
    return turns[np.arange(len(turns)) % 2], centre


def one_point(rng: Any, turns: Any, centre: Any) -> Any:
    return turns, np.repeat(centre[:1], len(turns), axis=0)


def collinear(rng: Any, turns: Any, centre: Any) -> Any:
    along = np.array([rng.normal(), 0.15 * rng.normal(), rng.normal()])
    along /= np.linalg.norm(along)
    return turns, [0.0, 2.2, 0.0] + np.linspace(-9, 9, len(turns))[:, None] * along


def two_postures(rng: Any, turns: Any, centre: Any) -> Any:
    which = np.arange(len(turns)) % 2
    return turns[which], centre[which]


def pure_repeats(rng: Any, turns: Any, centre: Any) -> Any:
    """The paper's experiment: three postures, three times each."""
    which = np.arange(len(turns)) % 3
    return turns[which], centre[which]


CASES = {
    same_orientation: "translation along .* and 2 more directions.*nearly the same orientation",
    one_axis: "do not determine the translation along .*(turn about one axis|nearly the same orientation)",
    two_orientations: "do not determine the translation along .*(only two orientations|nearly the same orientation)",
    one_point: "do not determine the rotation about .* and 2 more directions.*one point of the profile",
    collinear: "do not determine the rotation about .*on one line",
    two_postures: "at least 4 distinct postures .* found 2",
    pure_repeats: "at least 4 distinct postures .* found 3",
}


@pytest.mark.parametrize("jitter", [0.0, 1.0], ids=["exact", "jitter"])
@pytest.mark.parametrize(("degenerate", "words"), CASES.items(), ids=lambda c: getattr(c, "__name__", ""))
def test_degenerate_sets(degenerate: Any, words: str, jitter: float) -> None:
    """Jitter of 0.1 deg and 0.1 mm makes all of them full rank; they are refused all the same."""
    rng = np.random.default_rng(0)
    turns, centre = degenerate(rng, *postures(rng, 9))
    shaken = Rotation.from_matrix(turns) * Rotation.from_rotvec(jitter * rng.normal(0, np.radians(0.1), (9, 3)))
    made = cell(rng, shaken.as_matrix(), centre + jitter * rng.normal(0, 0.1, (9, 3)))
    with pytest.raises(InputError, match=rf"^sphere\.h5: /robot: .*{words}"):
        calibrated(rng, made, off_design(rng))


def test_four_postures_are_never_silently_wrong() -> None:
    """Three degrees of freedom leave rivals: either the answer is right, or it is refused."""
    refused = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        made = cell(rng, *postures(rng, 4))
        try:
            found = calibrated(rng, made, off_design(rng, 10.0, 20.0))
        except InputError as refusal:
            refused += "which side of the laser plane" in str(refusal) or "do not determine" in str(refusal)
            continue
        error = found.hand_eye.flange_from_profiler[:3, 3] - TRUE[:3, 3]
        assert error @ np.linalg.solve(found.covariance[:3, :3], error) < 30.0
    assert 0 < refused < 8


def test_centres_that_lie_in_one_plane_have_a_mirror_image() -> None:
    """All centres at the same distance from the laser plane: on which side is not to be told but by the design."""
    rng = np.random.default_rng(3)
    turns, centre = postures(rng, 9)
    centre[:, 1] = 2.5
    with pytest.raises(InputError, match=r"two hand-eye poses, .* on which side of the laser plane"):
        calibrated(rng, cell(rng, turns, centre))
