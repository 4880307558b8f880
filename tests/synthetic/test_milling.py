"""Lines cut by a cylinder, with a flat or a ball end: against points on the cutter, and finer and finer steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.synthetic.milling import Lines, Sweep, cut_lines

RADIUS, TIP = 5.0, 6.0
SIZE = (81, 61)


def lines(floor=-50.0):
    """Lines along z at x = -4 .. 4 (columns) and y = -3 .. 3 (rows), 0.1 mm apart."""
    base = np.zeros((SIZE[0], 3))
    base[:, 0] = np.linspace(-4, 4, SIZE[0])
    along = np.tile([0.0, 1.0, 0.0], (SIZE[0], 1)), np.tile([0.0, 0.0, 1.0], (SIZE[0], 1))
    return Lines(base, *along, -3.0, 0.1, np.full(SIZE, floor))


def swept(frames, positions, step=0.1, radius=RADIUS, floor=-50.0, start=np.inf, ball=False):
    """Heights after a sweep through tool frames: columns of each matrix are x, y, z of the tool."""
    frames, positions = np.array(frames, float), np.array(positions, float)
    pieces = len(positions) - 1
    columns = np.zeros(pieces, np.int64), np.full(pieces, SIZE[0])
    axes = frames[:, :, 0].copy(), frames[:, :, 2].copy()
    sweep = Sweep(positions, *axes, np.full(len(frames), radius), RADIUS, TIP, ball, *columns)
    height = np.full(SIZE, start)
    cut_lines(height, lines(floor), sweep, step)
    return height


def points(height):
    """Points (U, W, 3) at the heights of the lines."""
    x, y = np.meshgrid(np.linspace(-4, 4, SIZE[0]), np.linspace(-3, 3, SIZE[1]), indexing="ij")
    return np.stack([x, y, height], axis=-1)


LYING = np.stack([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]], axis=-1)  # axis along y, x of the tool downwards


@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_a_standing_cutter_leaves_its_own_surface(seed, ball):
    """However it leans: cut points lie on its flank or its end, and just above them is its inside."""
    rng = np.random.default_rng(seed)
    frame = Rotation.from_rotvec(rng.normal(0, 0.8, 3)).as_matrix() @ LYING
    position = rng.uniform(-1.5, 1.5, 3)
    height = swept([frame, frame], [position, position], ball=ball)
    cut = np.isfinite(height)
    assert cut.sum() > 100

    def inside(at):
        offset = at - (position - RADIUS * frame[:, 0])
        along = offset @ frame[:, 2]
        aside = np.linalg.norm(offset - along[..., None] * frame[:, 2], axis=-1)
        if ball:
            return np.hypot(aside, np.maximum(along - TIP, 0.0)) - RADIUS
        return np.maximum(aside - RADIUS, along - TIP)  # below 0: inside

    at = points(np.where(cut, height, 0.0))
    up = np.array([0, 0, 1.0])
    assert np.abs(inside(at)[cut]).max() < 1e-9
    assert (inside(at + 1e-4 * up) < 1e-9)[cut].mean() > 0.99  # but where the line only touches
    for below in (1e-4, 0.3, 5.0):
        assert (inside(at - below * up) > -1e-9)[cut].all()
    beside = points(np.zeros(SIZE))[~cut]
    assert all((inside(beside + z * up) > -1e-6).all() for z in np.linspace(-20, 20, 81))


def test_a_ball_end_leaves_a_fillet_behind_the_groove():
    """The same cut: beyond the cylinder's end at y = 2 it rises on a circle of its radius."""
    height = swept([LYING, LYING], [[-20.0, -4, -1], [20, -4, -1]], step=0.01, ball=True)
    y = np.linspace(-3, 3, SIZE[1])
    round_end = -1.0 + RADIUS - np.sqrt(RADIUS**2 - np.maximum(y - 2.0, 0.0) ** 2)
    assert np.abs(height - round_end).max() < 1e-5


def test_a_cutter_below_the_part_does_not_cut_it():
    assert np.isinf(swept([LYING, LYING], [[-1.0, 0, -30], [1, 0, -30]], floor=-15.0)).all()
    through = swept([LYING, LYING], [[-1.0, 0, -18], [1, 0, -18]], floor=-15.0)
    assert through[40, 30] == -15.0
