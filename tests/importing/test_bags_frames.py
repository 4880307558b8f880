"""Chains of frames against scipy's rotations and against exact motions."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from tests.importing.bag_files import TRANSFORM, Ros
from workbench.errors import InputError
from workbench.importing.bags_reader import FrameTree, chained
from workbench.units import Float

ROS = Ros("mcap")
RNG = np.random.default_rng(20)


def random_pose() -> RigidTransform:
    return RigidTransform.from_components(RNG.uniform(-1, 1, 3), Rotation.random(rng=RNG))


def add(tree: FrameTree, parent: str, child: str, pose: RigidTransform, time_s: float | None = None) -> None:
    """A link in m, static without a time."""
    q = pose.rotation.as_quat(scalar_first=True)
    message = ROS.pose(TRANSFORM, time_s or 0.0, pose.translation, q, parent, child)
    tree.add(message, time_s or 0.0, time_s is None, 1e3, "bag")


def in_mm(pose: RigidTransform) -> Float:
    matrix = pose.as_matrix()
    matrix[:3, 3] *= 1e3
    return np.asarray(matrix)


def test_links_are_looked_up_at_common_times() -> None:
    """Two links at different times, each a uniform screw motion: the chain is exact at the times of both."""
    tree, start, rate = FrameTree("bag"), random_pose(), np.array([0.1, -0.2, 0.15])

    def screw(t: float) -> RigidTransform:
        turned = start.rotation * Rotation.from_rotvec(rate * t)
        return RigidTransform.from_components(start.translation + rate * t, turned)

    def slide(t: float) -> RigidTransform:
        return RigidTransform.from_translation(np.array([0.3, 0, 0]) * t)

    for t in np.arange(10, 51, 5) / 10:
        add(tree, "base", "arm", screw(t), t)
    for t in np.arange(12, 41, 4) / 10:
        add(tree, "arm", "flange", slide(t), t)
    time_s, found = chained(tree.chain("base", "flange"), "bag")
    assert time_s[0] == 1.2
    assert time_s[-1] == 4.0
    assert len(time_s) == 6 + 8 - 2  # 1.5 to 4.0 and 1.2 to 4.0; 2.0 and 4.0 are in both
    for t, pose in zip(time_s, found, strict=True):
        np.testing.assert_allclose(pose, in_mm(screw(t) * slide(t)), atol=1e-9)


def test_what_cannot_be_chained_is_told() -> None:
    tree = FrameTree("bag")
    add(tree, "base", "arm", random_pose())
    add(tree, "table", "part", random_pose())
    with pytest.raises(InputError, match="unknown frame 'bas'; did you mean 'base'"):
        tree.chain("bas", "arm")
    with pytest.raises(InputError, match="no chain of frames between 'base' and 'part'"):
        tree.chain("base", "part")
    with pytest.raises(InputError, match="expected frame 'arm' under 'base' as before"):
        add(tree, "table", "arm", random_pose())


def test_moving_links_need_a_common_time() -> None:
    tree = FrameTree("bag")
    for t in (1.0, 2.0):
        add(tree, "base", "arm", random_pose(), t)
        add(tree, "arm", "flange", random_pose(), t + 2)
    with pytest.raises(InputError, match="no time in common"):
        chained(tree.chain("base", "flange"), "bag")


def test_repeats_count_once_and_contradictions_are_refused() -> None:
    tree, pose = FrameTree("bag"), random_pose()
    for t in (2.0, 1.0, 1.0):
        add(tree, "base", "flange", pose, t)
    assert len(chained(tree.chain("base", "flange"), "bag")[0]) == 2
    add(tree, "base", "flange", random_pose(), 2.0)
    with pytest.raises(InputError, match=r"two different poses at 2\.0 s"):
        tree.chain("base", "flange")
