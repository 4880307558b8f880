"""Where one cloud lies on another, from no start: a part without symmetry, anywhere and seen in part."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.coarse import coarse_registration
from workbench.units import Float

PLACE, ELSEWHERE = np.array([900.0, -300.0, 500.0]), np.array([-2000.0, 100.0, 4000.0])


def corner(rng: np.random.Generator) -> Float:
    """Points (n, 3) of three rectangles at an edge each, of different sizes, and of a step on one of them."""
    a, b = rng.uniform(size=(2, 6000))
    faces = [
        (60 * a, 40 * b, 0 * a),
        (60 * a, 0 * a, 25 * b),
        (0 * a, 40 * a, 25 * b),
        (35 + 15 * a, 10 + 20 * b, 8 + 0 * a),
    ]
    return np.concatenate([np.column_stack(face) for face in faces])


@pytest.mark.parametrize("share", [1.0, 0.85])
def test_a_part_is_found_wherever_it_lies_the_best_pose_first(share: float) -> None:
    target = corner(np.random.default_rng(3)) + PLACE
    source = corner(np.random.default_rng(4))
    source = source[source[:, 0] <= share * 60.0] + PLACE
    turn = Rotation.from_euler("xyz", [130.0, -40.0, 75.0], degrees=True)
    found = coarse_registration(turn.apply(source) + ELSEWHERE, target, 2.0)
    back = found[0].target_from_source
    at = (turn.apply(source) + ELSEWHERE) @ back[:3, :3].T + back[:3, 3]
    assert np.linalg.norm(at - source, axis=1).max() < 1.0
    assert back[:3, :3] @ back[:3, :3].T == pytest.approx(np.eye(3), abs=1e-14)
    assert found[0].overlap > 0.95
    assert found[0].rms_mm < 1.5
    assert [one.overlap for one in found] == sorted((one.overlap for one in found), reverse=True)
