"""Orientations as robot controllers write them, to unit quaternions (w, x, y, z). Angles in rad, arrays over rows.

Sources: ABB RAPID reference (`orient`, q1 is the scalar); docs.baslerweb.com/stereovisard, pose formats: FANUC W P R,
R = Rz(R) Ry(P) Rx(W); KUKA A B C, R = Rz(A) Ry(B) Rx(C); Yaskawa Rx Ry Rz, R = Rz Ry Rx; Universal Robots, rotation
vector in rad. ABB's pendant shows EulerZYX as X, Y, Z: R = Rz Ry Rx. Staubli VAL 3 (`trsf`): rx about x, ry about the
new y, rz about the newest z: R = Rx Ry Rz.
"""

from __future__ import annotations

import itertools

import numpy as np

from workbench.geometry.poses import quaternion_from_rotation, rotation_from_vector
from workbench.units import Float

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
