"""Rotations and rigid motions as arrays, vectorised over any leading axes.

A pose `a_from_b` is a 4x4 matrix on column vectors that maps coordinates in b to coordinates in a. Quaternions are
(w, x, y, z). Angles in rad. Functions here trust their input; `is_rigid` is the check for what comes from outside.

Orientations as robot controllers write them, to unit quaternions, by sources: ABB RAPID reference (`orient`, q1 is the
scalar); docs.baslerweb.com/stereovisard, pose formats: FANUC W P R, R = Rz(R) Ry(P) Rx(W); KUKA A B C, R = Rz(A) Ry(B)
Rx(C); Yaskawa Rx Ry Rz, R = Rz Ry Rx; Universal Robots, rotation vector in rad. ABB's pendant shows EulerZYX as X, Y,
Z: R = Rz Ry Rx. Staubli VAL 3 (`trsf`): rx about x, ry about the new y, rz about the newest z: R = Rx Ry Rz.
"""

from __future__ import annotations

import itertools

import numpy as np

from workbench.units import Float

RIGID_TOLERANCE = 1e-6  # largest entry of R R^T - 1 that still counts as a rotation (INTERFACES section 0)
ORDERS = tuple(
    "".join(axes) for axes in itertools.product("xyz", repeat=3) if axes[0] != axes[1] and axes[1] != axes[2]
)
_EULER = {  # name -> axes in the order of the columns; True: about the moving axes
    **{f"euler_{axes}_{kind}": (axes, kind == "intrinsic") for axes in ORDERS for kind in ("intrinsic", "extrinsic")},
    "fanuc_wpr": ("xyz", False),
    "kuka_abc": ("zyx", True),
    "abb_xyz": ("xyz", False),
    "yaskawa_rxyz": ("xyz", False),
    "staubli_rxyz": ("xyz", True),
}
_QUATERNION = {"quaternion_wxyz": (0, 1, 2, 3), "abb": (0, 1, 2, 3), "quaternion_xyzw": (3, 0, 1, 2)}
_VECTOR = ("rotation_vector", "ur")
CONVENTIONS = (*_QUATERNION, *_VECTOR, *sorted(_EULER, key=lambda name: name.startswith("euler")))
USUAL_ANGLE_UNIT = {  # what the controller itself writes
    **dict.fromkeys(("fanuc_wpr", "kuka_abc", "abb_xyz", "yaskawa_rxyz", "staubli_rxyz"), "deg"),
    "ur": "rad",
}


RIGID = "expected a rigid motion: rotation orthonormal to 1e-6, determinant +1, last row 0 0 0 1"


def is_rigid(pose: Float, tolerance: float = RIGID_TOLERANCE) -> bool:
    """Whether `pose` (4, 4) is a proper rigid motion: orthonormal to `tolerance`, determinant +1, last row 0 0 0 1."""
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or np.abs(pose[:3, :3]).max() > 2:  # squares may overflow
        return False
    rotation = pose[:3, :3]
    orthonormal = np.abs(rotation @ rotation.T - np.eye(3)).max() <= tolerance
    return bool(orthonormal and np.linalg.det(rotation) > 0 and (pose[3] == (0.0, 0.0, 0.0, 1.0)).all())


def pose_from(rotation: Float, translation_mm: Float) -> Float:
    """Poses (..., 4, 4) from rotations (..., 3, 3) and translations (..., 3)."""
    leading = np.broadcast_shapes(rotation.shape[:-2], translation_mm.shape[:-1])
    pose = np.zeros((*leading, 4, 4))
    pose[..., :3, :3] = rotation
    pose[..., :3, 3] = translation_mm
    pose[..., 3, 3] = 1.0
    return pose


def inverse(a_from_b: Float) -> Float:
    """`b_from_a` (..., 4, 4) of rigid motions, by transposition."""
    transposed = np.swapaxes(a_from_b[..., :3, :3], -1, -2)
    return pose_from(transposed, -(transposed @ a_from_b[..., :3, 3:])[..., 0])


def mapped(a_from_b: Float, points: Float) -> Float:
    """Coordinates in a of points (..., 3) in b, by one pose (4, 4) for all or by poses (..., 4, 4), one for each."""
    rotation, shift = a_from_b[..., :3, :3], a_from_b[..., :3, 3]
    if a_from_b.ndim == 2:
        return np.asarray(points @ rotation.T + shift)
    return np.asarray((rotation @ points[..., None])[..., 0] + shift)


def unit(vectors: Float) -> Float:
    """Vectors (..., 3) at length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def cross(a: Float, b: Float) -> Float:
    """a x b of vectors (..., 3); numpy's own takes five times as long for a few."""
    behind, ahead = np.array([1, 2, 0]), np.array([2, 0, 1])
    return np.asarray(a.take(behind, -1) * b.take(ahead, -1) - a.take(ahead, -1) * b.take(behind, -1))


def frame_about(direction: Float, near: Float | None = None) -> Float:
    """Right-handed rows (..., 3, 3): two unit vectors square to unit vectors (..., 3), then these.

    The first is by `near` (..., 3); by default by the axis that is most square to the vector.

    Example:
        >>> frame_about(np.array([0.0, 0.0, 1.0])).tolist()
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    near = np.eye(3)[np.argmin(np.abs(direction), axis=-1)] if near is None else near
    first = near - (near * direction).sum(axis=-1, keepdims=True) * direction
    first = unit(first)
    return np.stack([first, cross(direction, first), direction], axis=-2)


def in_planes(base_from_profiler: Float, x: Float, z: Float) -> Float:
    """Points (n, 3) in the base at x, z (n,) of laser planes at poses (n, 4, 4).

    Example:
        >>> in_planes(np.eye(4)[None], np.array([1.0]), np.array([2.0])).tolist()
        [[1.0, 0.0, 2.0]]
    """
    return mapped(base_from_profiler, np.stack([x, np.zeros(x.shape), z], axis=-1))


def rotation_from_quaternion(quaternion_wxyz: Float) -> Float:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4); q and -q give the same."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion_wxyz, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), (0, 1), (-2, -1)))


def quaternion_from_rotation(rotation: Float) -> Float:
    """Unit quaternions (..., 4), w >= 0, of rotation matrices (..., 3, 3).

    4 q q^T follows linearly from R; its row with the largest diagonal entry is q up to scale and loses no digits
    (Shepperd, J. Guidance and Control 1 (1978) 223).
    """
    r = np.asarray(rotation, float)
    a, b, c = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 1, 0] + r[..., 0, 1], r[..., 0, 2] + r[..., 2, 0], r[..., 2, 1] + r[..., 1, 2]
    rows = [
        [1 + a + b + c, wx, wy, wz],
        [wx, 1 + a - b - c, xy, xz],
        [wy, xy, 1 - a + b - c, yz],
        [wz, xz, yz, 1 - a - b + c],
    ]
    outer = np.ascontiguousarray(np.moveaxis(np.array(rows), (0, 1), (-2, -1)))
    best = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(outer, best[..., None, None], axis=-2)[..., 0, :]
    q = unit(q)
    return np.asarray(np.where(q[..., :1] < 0, -q, q))


def slerp(start_wxyz: Float, end_wxyz: Float, fraction: Float) -> Float:
    """Unit quaternions at `fraction` (...) of the shortest turn from `start_wxyz` to `end_wxyz` (..., 4).

    Shoemake's sin((1-f)a)/sin(a), sin(fa)/sin(a), where a, at most 90 deg, comes from the chord: exact for small turns.
    """
    start, end = np.asarray(start_wxyz, float), np.asarray(end_wxyz, float)
    end = np.where(np.sum(start * end, axis=-1, keepdims=True) < 0, -end, end)
    angle = 2 * np.arctan2(np.linalg.norm(end - start, axis=-1), np.linalg.norm(end + start, axis=-1))
    f = np.asarray(fraction, float)
    turning = angle > 1e-12
    sine = np.where(turning, np.sin(angle), 1.0)
    from_start = np.where(turning, np.sin((1 - f) * angle) / sine, 1 - f)
    from_end = np.where(turning, np.sin(f * angle) / sine, f)
    q = from_start[..., None] * start + from_end[..., None] * end
    return unit(q)


def interpolate_poses(time_s: Float, pose_time_s: Float, position_mm: Float, quaternion_wxyz: Float) -> Float:
    """Poses (N, 4, 4) at the times `time_s` (N,) from K >= 1 poses at rising times: the paper's section 4.1.

    Position linearly, orientation by slerp, between the two poses around each time. A single pose holds at all times.

    Raises:
        ValueError: a time lies outside the pose times.
    """
    if len(pose_time_s) == 1:
        index, fraction = np.zeros(len(time_s), int), np.zeros(len(time_s))
        after = index
    else:
        if len(time_s) and not (pose_time_s[0] <= time_s.min() and time_s.max() <= pose_time_s[-1]):
            raise ValueError("a time lies outside the pose times")
        index = np.clip(np.searchsorted(pose_time_s, time_s, side="right") - 1, 0, len(pose_time_s) - 2)
        after = index + 1
        fraction = (time_s - pose_time_s[index]) / (pose_time_s[after] - pose_time_s[index])
    f = fraction[:, None]
    position = (1 - f) * position_mm[index] + f * position_mm[after]
    return pose_from(
        rotation_from_quaternion(slerp(quaternion_wxyz[index], quaternion_wxyz[after], fraction)), position
    )


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Float:
    """R (3, 3) = Rz(roll) Ry(pitch) Rx(yaw): the paper's order, in which roll turns about z and yaw about x."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    return np.array(
        [
            [cr * cp, cr * sp * sy - sr * cy, cr * sp * cy + sr * sy],
            [sr * cp, sr * sp * sy + cr * cy, sr * sp * cy - cr * sy],
            [-sp, cp * sy, cp * cy],
        ]
    )


def rpy_from_rotation(rotation: Float) -> tuple[float, float, float]:
    """(roll, pitch, yaw) with R = Rz(roll) Ry(pitch) Rx(yaw), |pitch| <= 90 deg; yaw is 0 where it merges with roll."""
    r = np.asarray(rotation, float)
    cosine = float(np.hypot(r[0, 0], r[1, 0]))
    pitch = float(np.arctan2(-r[2, 0], cosine))
    if cosine < 1e-12:
        return float(np.arctan2(-r[0, 1], r[1, 1])), pitch, 0.0
    return float(np.arctan2(r[1, 0], r[0, 0])), pitch, float(np.arctan2(r[2, 1], r[2, 2]))


def rotation_from_vector(rotation_vector: Float) -> Float:
    """exp: rotation matrices (..., 3, 3) of rotation vectors (..., 3), axis times angle (Rodrigues)."""
    v = np.asarray(rotation_vector, float)
    half = np.linalg.norm(v, axis=-1, keepdims=True) / 2
    return rotation_from_quaternion(np.concatenate([np.cos(half), v / 2 * np.sinc(half / np.pi)], axis=-1))


def vector_from_rotation(rotation: Float) -> Float:
    """log: rotation vectors (..., 3), angle within 0 to pi, of rotation matrices (..., 3, 3)."""
    q = quaternion_from_rotation(rotation)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., :1])
    return np.asarray(q[..., 1:] * np.where(sine > 1e-15, angle / np.maximum(sine, 1e-15), 2.0))


def components(convention: str) -> int:
    """Numbers an orientation: 4 of a quaternion, else 3."""
    return 4 if convention in _QUATERNION else 3


def quaternions(values: Float, convention: str) -> Float:
    """Quaternions (K, 4), w first, of orientations (K, 3 or 4) in one of `CONVENTIONS`.

    Quaternions are reordered, neither normalised nor checked. Euler angles stand in the order of their axes' names:
    `euler_zyx_intrinsic` turns by the first angle about z, then about the new y, then about the newest x; extrinsic
    turns about axes that stay.
    """
    if convention in _QUATERNION:
        return np.asarray(values, float)[:, _QUATERNION[convention]]
    if convention in _VECTOR:
        return quaternion_from_rotation(rotation_from_vector(values))
    axes, intrinsic = _EULER[convention]
    first, second, third = (
        rotation_from_vector(angle[:, None] * np.eye(3)["xyz".index(axis)])
        for angle, axis in zip(values.T, axes, strict=True)
    )
    return quaternion_from_rotation(first @ second @ third if intrinsic else third @ second @ first)
