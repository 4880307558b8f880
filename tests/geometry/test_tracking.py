"""Faces followed through the frames of a pass, against the lines that the frames were made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from workbench.geometry import tracking
from workbench.geometry.tracking import (
    BEVEL,
    CLEAR,
    COUNT,
    CUT,
    FIRST,
    LAST,
    LOWER,
    MIXED,
    OFFSET,
    ROOT,
    SLOPE,
    SXX,
    SXZ,
    SZZ,
    UPPER,
    X_MEAN,
    Z_MEAN,
    Followed,
    KeyFrames,
    Profiles,
    face_sigmas,
    follow,
)
from workbench.units import AnyArray, Bool, Float, Float32, Int

FRAMES, COLUMNS, PITCH_MM, NOISE_MM = 60, 500, 0.05, 0.01
SLOPES = np.array([-0.9, 0.1, 1.0, -0.8])  # of the faces in chain order, side = +1, z away
NAMES = np.array([3, 2, 1, 4])


@dataclass
class Pass:
    """Frames of an edge whose faces drift, the true lines, and what `follow` made of them."""

    x: Float32
    z: Float32
    keep: Bool
    side: float
    lines: Float  # (n, 4, 2) slope and offset
    corners: Float  # (n, 4) x of: upper/bevel, bevel/root, end of root, end of lower surface
    states: Float  # (n, 4, 4) true
    sums: Float | None = None
    end: Float | None = None
    seen: Bool | None = None
    labels: AnyArray | None = None


def scene(
    seed: int = 1, side: int = 1, rises: bool = True, upper: bool = True, lower: bool = False, start_mm: float = -12.5
) -> Pass:
    """An edge that wanders by a mm or so over the pass, its faces turning and the root face changing a little."""
    rng = np.random.default_rng(seed)
    at = np.linspace(0, 1, FRAMES)
    slopes = SLOPES + 0.03 * np.outer(np.sin(3 * at), [1, 1, -1, 1])
    upper_bevel, bevel_root = -6 + 0.8 * at, 1.0 + 1.2 * np.sin(2 * at)
    root_end = bevel_root + 1.1 + 0.15 * at
    u = start_mm + (np.arange(COLUMNS) + rng.uniform(0, 1, (FRAMES, 1))) * PITCH_MM
    level = 100 + 2 * at + rng.normal(0, 0.05, FRAMES)  # the frames vibrate
    offsets = np.empty((FRAMES, 4))
    offsets[:, BEVEL] = level
    offsets[:, UPPER] = level + (slopes[:, BEVEL] - slopes[:, UPPER]) * upper_bevel
    offsets[:, ROOT] = level + (slopes[:, BEVEL] - slopes[:, ROOT]) * bevel_root
    offsets[:, LOWER] = offsets[:, ROOT] + (slopes[:, ROOT] - slopes[:, LOWER]) * root_end
    bounds = np.stack([upper_bevel, bevel_root, root_end, root_end + 5], axis=1)
    face = (u[:, :, None] > bounds[:, None, :3]).sum(axis=2)
    z = np.take_along_axis(slopes, face, 1) * u + np.take_along_axis(offsets, face, 1)
    beyond = u > bounds[:, 2:3] if not lower else u > bounds[:, 3:4]
    z = np.where(beyond, 130 + 0.1 * u, z)  # the table, far behind
    if not upper:
        z[u < bounds[:, :1]] = np.nan
    z += rng.normal(0, NOISE_MM, z.shape)
    states = np.zeros((FRAMES, 4, 4))
    states[:, :, SLOPE], states[:, :, OFFSET] = side * slopes, offsets
    states[:, :, tracking.SEEN] = (upper, 1, 1, lower)
    free = np.stack([np.full(FRAMES, start_mm), upper_bevel, root_end, bounds[:, 3]], axis=1)
    states[:, :, tracking.END] = side * free
    x = side * u
    if rises != (side > 0):
        x, z = x[:, ::-1], z[:, ::-1]
    x, z = np.ascontiguousarray(x, dtype=np.float32), np.ascontiguousarray(z, dtype=np.float32)
    lines = np.stack([side * slopes, offsets], axis=2)
    return Pass(x, z, np.isfinite(z), float(side), lines, side * bounds, states)


def followed(made: Pass, keys: tuple[int, ...] = (10, 40)) -> Pass:
    at: Int = np.array(keys)
    made.sums, made.end = np.zeros((FRAMES, 4, 8)), np.full((FRAMES, 5), np.nan)
    made.seen, made.labels = np.zeros(FRAMES, bool), np.zeros(made.x.shape, np.uint8)
    known = KeyFrames(at, made.states[at].copy(), np.full(4, NOISE_MM))
    found = Followed(made.sums, made.end, made.seen, made.labels)
    follow(Profiles(made.x, made.z, made.keep), made.side, known, NAMES, 0.0, found)
    return made


def check_lines(made: Pass, faces: tuple[int, ...], sigmas: float = 5.0) -> None:
    assert made.sums is not None
    for f in faces:
        n, x, z, sxx, sxz = (made.sums[made.seen, f, k] for k in (COUNT, X_MEAN, Z_MEAN, SXX, SXZ))
        slope, offset = made.lines[made.seen, f].T
        assert (np.abs(sxz / sxx - slope) < sigmas * NOISE_MM / np.sqrt(sxx)).all()
        assert (np.abs(z - slope * x - offset) < sigmas * NOISE_MM / np.sqrt(n)).all()


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("rises", [True, False])
@pytest.mark.parametrize(("upper", "lower"), [(True, False), (False, False), (True, True)])
def test_every_frame_shows_its_lines(side: int, rises: bool, upper: bool, lower: bool) -> None:
    made = followed(scene(2, side, rises, upper, lower))
    assert made.seen is not None
    assert made.sums is not None
    assert made.seen.all()
    check_lines(made, (*((UPPER,) if upper else ()), BEVEL, ROOT, *((LOWER,) if lower else ())))
    if not lower:
        assert (made.sums[:, LOWER, COUNT] == 0).all()


def test_sums_are_those_of_the_points_named() -> None:
    """Means and centred sums over the points of the face between its first and last column."""
    made = followed(scene(3, -1, False))
    assert made.sums is not None
    for i in (0, 33, 59):
        for f in (BEVEL, ROOT):
            row = made.sums[i, f]
            columns = np.arange(int(row[FIRST]), int(row[LAST]) + 1)
            x, z = made.x[i, columns].astype(float), made.z[i, columns].astype(float)
            good = np.abs(z - made.lines[i, f, 0] * x - made.lines[i, f, 1]) < 4 * NOISE_MM
            assert row[COUNT] == good.sum() == columns.size
            dx, dz = x - x.mean(), z - z.mean()
            np.testing.assert_allclose(
                row[[X_MEAN, Z_MEAN, SXX, SXZ, SZZ]], [x.mean(), z.mean(), dx @ dx, dx @ dz, dz @ dz], rtol=1e-6
            )


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("rises", [True, False])
def test_the_root_faces_last_return(side: int, rises: bool) -> None:
    """The last column before the end, its place on the line, and the step to the next one along the face."""
    made = followed(scene(4, side, rises))
    assert made.end is not None
    end_u, u = side * made.corners[:, 2:3], side * made.x.astype(float)
    last = np.where(u <= end_u, u, -np.inf).argmax(axis=1)
    np.testing.assert_array_equal(made.end[:, 3], last)
    slope, offset = made.lines[:, ROOT].T
    x = made.x[np.arange(FRAMES), last]
    np.testing.assert_allclose(made.end[:, 0], x, rtol=0, atol=1e-6)
    assert np.abs(made.end[:, 1] - slope * x - offset).max() < 5 * NOISE_MM
    np.testing.assert_allclose(made.end[:, 2], PITCH_MM * np.hypot(1, slope), rtol=0.02)
    assert (made.end[:, 4] == CLEAR).all()


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("rises", [True, False])
def test_how_the_root_face_ends_is_told(side: int, rises: bool) -> None:
    made = scene(5, side, rises)
    end_u, u = side * made.corners[:, 2:3], side * made.x.astype(float)
    last = np.where(u <= end_u, u, -np.inf).argmax(axis=1)
    out = 1 if (side > 0) == rises else -1
    for i in range(0, 20):  # a pixel that saw both the root face and the table
        made.z[i, last[i] + out] = 0.5 * (made.z[i, last[i]] + made.z[i, last[i] + 2 * out])
    for i in range(20, 40):  # something stands in front of it
        hidden = u[i] > end_u[i] - 0.3
        made.z[i, hidden] = made.z[i, last[i]] - 5.0
    followed(made)
    assert made.end is not None
    assert made.seen is not None
    assert made.seen.all()
    assert (made.end[:20, 4] == MIXED).all()
    np.testing.assert_array_equal(made.end[:20, 3], last[:20])
    assert (made.end[20:40, 4] == CUT).all()
    assert (made.end[40:, 4] == CLEAR).all()


@pytest.mark.parametrize("side", [1, -1])
def test_the_fields_limit_cuts_the_root_face(side: int) -> None:
    """The view ends at 2.9 mm, in later frames on the root face."""
    made = scene(6, side, upper=False, start_mm=-22.1)
    limit = (side * made.x).max(axis=1)
    on_root, beyond = side * made.corners[:, 2] > limit + 0.1, side * made.corners[:, 2] < limit - 0.5
    followed(made, (5, 30))
    assert made.end is not None
    assert made.seen is not None
    assert on_root.sum() > 10
    assert beyond.sum() > 5
    assert made.seen.all()
    assert (made.end[on_root, 4] == CUT).all()
    assert (made.end[beyond, 4] == CLEAR).all()


def test_strays_and_missing_returns_turn_no_line() -> None:
    rng = np.random.default_rng(7)
    made = scene(7)
    wild = rng.random(made.z.shape) < 0.05
    made.z[wild] += rng.uniform(-5, 5, wild.sum()).astype(np.float32)
    made.keep = rng.random(made.z.shape) > 0.2
    followed(made)
    assert made.seen is not None
    assert made.seen.mean() > 0.95
    check_lines(made, (UPPER, BEVEL, ROOT), sigmas=6)


def test_a_hidden_stretch_is_not_seen_and_the_faces_are_found_again() -> None:
    made = scene(8)
    made.keep[20:37] = False
    made.z[20:37] = np.nan
    followed(made)
    assert made.seen is not None
    assert made.sums is not None
    assert made.labels is not None
    np.testing.assert_array_equal(np.flatnonzero(~made.seen), np.arange(20, 37))
    assert (made.sums[20:37] == 0).all()
    assert (made.labels[20:37] == 0).all()
    check_lines(made, (BEVEL, ROOT))


def test_key_frames_at_either_end_reach_the_whole_pass() -> None:
    for keys in ((0, 59), (59,), (30,)):
        made = followed(scene(9), keys)
        assert made.seen is not None
        assert made.seen.all()
        check_lines(made, (BEVEL, ROOT))


def test_points_are_labelled_with_their_face() -> None:
    made = followed(scene(10, -1, True, True, True))
    assert made.labels is not None
    u, bounds = made.side * made.x.astype(float), made.side * made.corners
    face = (u[:, :, None] > bounds[:, None, :3]).sum(axis=2)
    expected = NAMES[face]
    inner = np.abs(u[:, :, None] - bounds[:, None, :]).min(axis=2) > 0.1
    inner &= u < bounds[:, 3:]
    named = inner & (made.labels > 0)
    np.testing.assert_array_equal(made.labels[named], expected[named])
    assert named.sum() > 0.99 * inner.sum()
    assert (made.labels[u > bounds[:, 3:] + 0.1] == 0).all()


def test_noise_of_each_face() -> None:
    made = scene(11, lower=True)
    face = (made.x.astype(float)[:, :, None] > made.corners[:, None, :3]).sum(axis=2)
    noisier = np.random.default_rng(12).normal(0, 0.02, made.z.shape)
    made.z[face == BEVEL] += noisier[face == BEVEL].astype(np.float32)
    sigma = np.full(4, 0.03)
    keys: Int = np.array([10, 40])
    sums, end = np.zeros((FRAMES, 4, 8)), np.full((FRAMES, 5), np.nan)
    seen, labels = np.zeros(FRAMES, bool), np.zeros(made.x.shape, np.uint8)
    known = KeyFrames(keys, made.states[keys].copy(), sigma)
    follow(Profiles(made.x, made.z, made.keep), 1.0, known, NAMES, 0.0, Followed(sums, end, seen, labels))
    found = face_sigmas(sums, seen)
    assert seen.all()
    np.testing.assert_allclose(found, [NOISE_MM, np.hypot(NOISE_MM, 0.02), NOISE_MM, NOISE_MM], rtol=0.1)
    assert (face_sigmas(np.zeros((5, 4, 8)), np.zeros(5, bool)) > 0).all()


def test_the_grid_and_the_key_states_stay() -> None:
    made = scene(13)
    x, z, keep, states = made.x.copy(), made.z.copy(), made.keep.copy(), made.states.copy()
    followed(made)
    for value, before in ((made.x, x), (made.z, z), (made.keep, keep), (made.states, states)):
        np.testing.assert_array_equal(value, before)
