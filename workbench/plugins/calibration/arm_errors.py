"""How a robot's geometry may differ from its model: joint offsets, lengths between axes, tilts of axes.

The chain is a product of exponentials: the joints' axes in the base, all joints at zero. An error moves all that lies
beyond its joint as one rigid body, by a small twist there (J. Hollerbach, W. Khalil, M. Gautier, Model identification,
Springer Handbook of Robotics, 2nd ed. 2016). Each parameter has a prior, so what the data leave open stays as it was
built, and as uncertain.

`robot.json` says what a robot's geometry is off, how sure that is, and what the measurements leave open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.api import (
    DEG,
    Chapter,
    Document,
    Float,
    InputFile,
    Int,
    Part,
    RobotFile,
    Shaped,
    estimator,
    frame_about,
    mapped,
    pieces,
)
from workbench.plugins.calibration.tables import results, sentence

if TYPE_CHECKING:  # the robot's libraries are heavy: a calibration without a cell does not load them
    from workbench.api import Chain

PARALLEL = 0.999  # cosine from which two axes are parallel
OPEN = 0.5  # u over the prior's, from which a parameter counts as left open
ALIKE = 0.7  # correlation from which two parameters are told to be hard to tell apart


@dataclass(frozen=True, slots=True, eq=False)
class ArmErrors:
    """P parameters of a chain: rad of offsets and tilts, mm of lengths."""

    names: tuple[str, ...]
    before: Shaped[Int, " P"]  # number of the axis, 0 to 5, from which on everything moves
    # of the base's origin (mm) and about it (rad), per unit of the parameter, joints at zero
    twist: Shaped[Float, "P 6"]
    prior: Shaped[Float, " P"]

    def __len__(self) -> int:
        return len(self.names)


def arm_errors(chain: Chain, offset: float = 0.3 * DEG, length_mm: float = 1.0, tilt: float = 0.0) -> ArmErrors:
    """All parameters that a chain has; none is kept twice, but for what data alone can tell apart.

    With which standard deviations it was built (0: right): of a joint's zero, of where an axis lies beside the one
    before, of an axis' direction.
    Beyond parallel axes a shift across their plane is two offsets; along an axis it belongs to the next one.
    """
    rows: list[tuple[str, int, Float, float]] = []
    for k in range(6):
        axis, point = chain.axes[k], chain.points_mm[k]
        if offset > 0.0:
            rows.append((f"offset of joint {k + 1}", k, _turn(axis, point), offset))
        if k and length_mm > 0.0:
            for way in _ways(chain, k):
                name = f"shift of axis {k + 1} along {_words(way)}"
                rows.append((name, k, np.concatenate([way, np.zeros(3)]), length_mm))
        if k and tilt > 0.0:
            for way in _across(axis):
                rows.append((f"tilt of axis {k + 1} about {_words(way)}", k, _turn(way, point), tilt))
    return ArmErrors(
        tuple(r[0] for r in rows),
        np.array([r[1] for r in rows], np.int64),
        np.array([r[2] for r in rows]).reshape(-1, 6),
        np.array([r[3] for r in rows]),
    )


NO_ERRORS = ArmErrors((), np.zeros(0, np.int64), np.zeros((0, 6)), np.zeros(0))


def corrected(chain: Chain, errors: ArmErrors, x: Float) -> tuple[Chain, ArmErrors]:
    """The chain with its errors `x` (P,), and the errors as they then act: more of each on top of those."""
    import pinocchio as pin

    moved = np.eye(4)
    axes, points, twist = chain.axes.copy(), chain.points_mm.copy(), errors.twist.copy()
    for k in range(6):
        for p in np.flatnonzero(errors.before == k):
            moved = moved @ pin.exp6(errors.twist[p] * x[p]).homogeneous
            turn = moved[:3, :3] @ errors.twist[p, 3:]
            twist[p] = np.concatenate([moved[:3, :3] @ errors.twist[p, :3] + np.cross(moved[:3, 3], turn), turn])
        axes[k] = moved[:3, :3] @ chain.axes[k]
        points[k] = mapped(moved, chain.points_mm[k])
    flange = moved @ chain.base_from_flange_at_zero
    return replace(chain, axes=axes, points_mm=points, base_from_flange_at_zero=flange), replace(errors, twist=twist)


def pose_derivatives(chain: Chain, errors: ArmErrors, joints: Float) -> Float:
    """Of the flange's place in the base (mm) and of its turn in its own axes (rad), by the errors: (n, 6, P)."""
    from workbench.api import motions

    moved = motions(chain, joints)
    flange = moved[:, 6] @ chain.base_from_flange_at_zero
    here = moved[:, errors.before]  # (n, P, 4, 4)
    turn = np.einsum("npij,pj->npi", here[..., :3, :3], errors.twist[:, 3:])
    shift = np.einsum("npij,pj->npi", here[..., :3, :3], errors.twist[:, :3]) + np.cross(here[..., :3, 3], turn)
    place = shift + np.cross(turn, flange[:, None, :3, 3])
    own = np.einsum("nji,npj->npi", flange[:, :3, :3], turn)
    return np.concatenate([place, own], axis=2).mT


def erring_flange(chain: Chain, errors: ArmErrors, x: Float, joints: Float) -> tuple[Float, Float]:
    """`base_from_flange` (n, 4, 4) of the chain with its errors `x` (P,), and its derivatives (n, 6, P) by them."""
    from workbench.api import forward_kinematics

    now, more = corrected(chain, errors, x)
    return forward_kinematics(now, joints), pose_derivatives(now, more, joints)


def chain_of(cell: InputFile | None) -> Chain | None:
    """The cell's robot; None without a cell."""
    from workbench.api import read_cell

    return None if cell is None else read_cell(cell).chain


def _turn(axis: Float, point: Float) -> Float:
    return np.concatenate([np.cross(point, axis), axis])


def _ways(chain: Chain, k: int) -> list[Float]:
    """Directions along which axis k may lie beside axis k - 1, square to itself."""
    axis, before = chain.axes[k], chain.axes[k - 1]
    if abs(axis @ before) < PARALLEL:
        return list(_across(axis))
    apart = chain.points_mm[k] - chain.points_mm[k - 1]
    apart = apart - (apart @ axis) * axis
    length = np.linalg.norm(apart)
    return [apart / length] if length > 1.0 else list(_across(axis))


def _across(axis: Float) -> Float:
    """Two unit vectors square to an axis, along the base's axes where that is possible."""
    first, second, _ = frame_about(axis)
    return np.stack([first, second * np.sign(second[np.abs(second).argmax()])])


def _words(way: Float) -> str:
    return "xyz"[int(np.abs(way).argmax())] if np.abs(way).max() > PARALLEL else "({:.2f}, {:.2f}, {:.2f})".format(*way)


def _left(arm: ArmErrors, covariance: Float, u: Float) -> list[str]:
    """Which parameters the measurements leave open, and what each cannot be told from."""
    said = []
    for k in np.flatnonzero(u >= OPEN * arm.prior):
        alike = np.abs(covariance[k]) / np.maximum(u * u[k], 1e-300)
        alike[k] = 0.0
        other = int(alike.argmax())
        cause = (
            f"it cannot be told from the {arm.names[other]}"
            if alike[other] > ALIKE
            else "what it does, the place of the robot or of what it carries does too"
        )
        share = 100.0 * (u[k] / arm.prior[k])
        said.append(f"the {arm.names[k]} is left nearly as built (u is {share:.0f} % of the prior): {cause}")
    return said


def robot_results(
    arm: ArmErrors, values: Float, covariance: Float, more: dict[str, Any], said: str, part: Part
) -> tuple[Document, Chapter]:
    """robot.json and the report's chapter: the parameters, and what was found, in words.

    `more`: what else the stage found, its verdict and warnings among it.
    """
    u = estimator.standard_u(covariance)
    parameters = []
    for k, name in enumerate(arm.names):
        unit, size = ("deg", DEG) if arm.twist[k, 3:].any() else ("mm", 1.0)
        found = {f"value_{unit}": values[k] / size, f"u_{unit}": u[k] / size}
        known = bool(u[k] < OPEN * arm.prior[k])
        parameters.append({"name": name, "axis": int(arm.before[k]) + 1, **found, "determined": known})
    document = {
        "frame": "base",
        "parameters": parameters,
        "covariance": covariance,  # of their values, mm and rad
        "left_as_built": _left(arm, covariance, u),
        **more,
    }
    rows = [
        (one["name"], _number(one, "value"), _number(one, "u"), "" if one["determined"] else "nearly as built")
        for one in parameters
    ]
    table = pieces.table_html(("Error of the arm", "found", "u", ""), rows) if rows else ""
    html = table + pieces.paragraph(f"{said} {sentence(more['verdict'])}")
    return results(RobotFile, "Robot calibration", part, document, html)


def _number(one: dict[str, Any], name: str) -> str:
    return f"{one[f'{name}_mm']:.3f} mm" if f"{name}_mm" in one else f"{one[f'{name}_deg']:.4f}°"
