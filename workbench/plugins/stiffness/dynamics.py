"""The robot in motion: mass of rigid links, springs and dampers about the joints, and what that is at the tool."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.api import (
    Bodies,
    Cell,
    Chain,
    Float,
    InputError,
    Shape,
    Shaped,
    jacobian_at,
    jacobian_derivative,
    joint_axes,
    motions,
)
from workbench.plugins.stiffness.elastic import MM, geometric_stiffness
from workbench.plugins.stiffness.stability import Dynamics
from workbench.plugins.stiffness.values import RobotModes, ToolMode


def bodies_of(cell: Cell, masses_kg: Sequence[float] | None) -> Bodies:
    """Masses of the links with the tool on the sixth: as the URDF has them, or even within the links' shapes.

    Raises:
        InputError: the URDF states none and none are given; a link without a shape.
    """
    bodies = cell.chain.bodies if masses_kg is None else _even(cell, masses_kg)
    if bodies is None:
        raise InputError(
            cell.source,
            "expected <inertial> with a mass for every link in the URDF, found none: give link_masses_kg (1,280 kg in "
            "all is an IRB 6700's), or tap tests to scale them",
        )
    if cell.tool_mass_kg is None:
        return bodies
    flange, at = cell.chain.base_from_flange_at_zero, cell.tool_centre_of_gravity_mm
    solids = [_solid(one) for one in cell.shapes if one.link == 6 and one.body == "tool"]
    middle, inertia = _together(solids) if solids else (flange[:3, 3], np.zeros((3, 3)))
    if at is not None:
        middle = flange[:3, :3] @ at + flange[:3, 3]
    mass = np.array([bodies.mass_kg[5], cell.tool_mass_kg])
    whole, centre, turning = _joined(
        mass, np.array([bodies.centre_mm[5], middle]), [bodies.inertia_kg_m2[5], cell.tool_mass_kg * inertia]
    )
    return Bodies(
        np.append(bodies.mass_kg[:5], whole),
        np.vstack([bodies.centre_mm[:5], centre]),
        np.concatenate([bodies.inertia_kg_m2[:5], turning[None]]),
    )


def _joined(mass: Float, centre_mm: Float, inertia: Sequence[Float]) -> tuple[float, Float, Float]:
    """Mass, centre (3,) and inertia (3, 3) about it of several bodies as one."""
    middle = mass @ centre_mm / mass.sum()
    off = (centre_mm - middle) / MM
    turned = [one + m * (v @ v * np.eye(3) - np.outer(v, v)) for m, v, one in zip(mass, off, inertia, strict=True)]
    return float(mass.sum()), middle, np.sum(turned, axis=0)


def _together(solids: Sequence[tuple[float, Float, Float]]) -> tuple[Float, Float]:
    """Centre (3,), mm, and inertia (3, 3) of a unit mass, m^2, spread evenly in solids."""
    volume = np.array([one[0] for one in solids])
    share = volume / volume.sum()
    _, centre, inertia = _joined(
        share, np.array([one[1] for one in solids]), [s * one[2] for s, one in zip(share, solids, strict=True)]
    )
    return centre, inertia


def _even(cell: Cell, masses_kg: Sequence[float]) -> Bodies:
    """Masses spread evenly in the shapes of each link."""
    found = []
    for link in range(1, 7):
        parts = [
            _solid(one) for one in cell.shapes if one.link == link and one.body not in ("tool", "cutter", "workpiece")
        ]
        if not parts:
            where = f"expected a collision shape of link {link} to spread its mass in, found none"
            raise InputError(cell.source, where)
        found.append(_together(parts))
    mass = np.array(masses_kg, float)
    return Bodies(
        mass, np.array([one[0] for one in found]), np.array([m * one[1] for m, one in zip(mass, found, strict=True)])
    )


def _solid(shape: Shape) -> tuple[float, Float, Float]:
    """Volume, mm^3, centre in the base, mm, and inertia of a unit mass, m^2, of a shape; a mesh must be closed."""
    turn = shape.pose[:3, :3]
    if shape.vertices_mm is None:
        volume, diagonal = _primitive(shape.kind, np.array(shape.size_mm))
        return volume, shape.pose[:3, 3], turn @ np.diag(diagonal) @ turn.T / MM**2
    corners = shape.vertices_mm[shape.triangles]
    six = np.linalg.det(corners)  # of the tetrahedra from the origin
    middle = (six[:, None] * corners.sum(axis=1)).sum(axis=0) / (4 * six.sum())
    off = corners - middle
    six, sums = np.linalg.det(off), off.sum(axis=1)
    square = np.einsum("t,ti,tj->ij", six, sums, sums) + np.einsum("t,tai,taj->ij", six, off, off)
    square = square / (20 * six.sum()) / MM**2
    inertia = np.trace(square) * np.eye(3) - square
    return abs(float(six.sum())) / 6, turn @ middle + shape.pose[:3, 3], turn @ inertia @ turn.T


def _primitive(kind: str, size: Float) -> tuple[float, Float]:
    """Volume and principal inertias of a unit mass, mm^2, of a box, sphere, cylinder or capsule along z."""
    if kind == "box":
        return float(size.prod()), (size @ size - size**2) / 12
    radius = float(size[0])
    if kind == "sphere":
        return 4 / 3 * np.pi * radius**3, np.full(3, 0.4 * radius**2)
    length = float(size[1])
    rod = np.array([(3 * radius**2 + length**2) / 12] * 2 + [radius**2 / 2])
    if kind == "cylinder":
        return np.pi * radius**2 * length, rod
    across = 0.4 * radius**2 + length**2 / 4 + 3 / 8 * radius * length  # of the caps: a ball drawn apart
    parts = np.array([np.pi * radius**2 * length, 4 / 3 * np.pi * radius**3])
    return float(parts.sum()), parts @ [rod, [across, across, 0.4 * radius**2]] / parts.sum()


def mass_matrices(chain: Chain, bodies: Bodies, joints: Shaped[Float, "k 6"]) -> Shaped[Float, "6 k 6 6"]:
    """What each link adds to the mass matrix about the joints, kg m^2."""
    axes, points = joint_axes(chain, joints)
    moved = motions(chain, joints)
    made = np.zeros((6, len(joints), 6, 6))
    for link in range(6):
        at = moved[:, link + 1]
        centre = at[:, :3, :3] @ bodies.centre_mm[link] + at[:, :3, 3]
        slope = jacobian_at(axes, points, centre)
        slope[:, :3] /= MM
        slope[:, :, link + 1 :] = 0.0
        inertia = at[:, :3, :3] @ bodies.inertia_kg_m2[link] @ np.swapaxes(at[:, :3, :3], 1, 2)
        linear, turning = slope[:, :3], slope[:, 3:]
        made[link] = bodies.mass_kg[link] * np.swapaxes(linear, 1, 2) @ linear
        made[link] += np.swapaxes(turning, 1, 2) @ inertia @ turning
    return made


def at_tool(
    chain: Chain, modes: RobotModes, joints: Float, base_from_tool: Float, force_n: Float | None = None
) -> Dynamics:
    """The robot's modes, and those of spindle and cutter, at the tool.

    Args:
        chain: the robot.
        modes: its masses, springs and dampers.
        joints: (k, 6) rad.
        base_from_tool: (k, 4, 4) frames whose origins the force acts at and whose axes are those of the result; z the
            cutter's.
        force_n: (k, 3) mean force there, base axes, whose own stiffness K_c counts (Chen and Kao 2000); None: none.
    """
    axes, points = joint_axes(chain, joints)
    slope = jacobian_at(axes, points, base_from_tool[:, :3, 3])
    springs = np.broadcast_to(np.diag(modes.nm_per_rad), (len(joints), 6, 6))
    if force_n is not None:
        wrench = np.concatenate([force_n, np.zeros_like(force_n)], axis=1)
        own = geometric_stiffness(jacobian_derivative(axes, slope), wrench)
        springs = springs - (own + np.swapaxes(own, 1, 2)) / 2
    root = np.linalg.cholesky(mass_matrices(chain, modes.bodies, joints).sum(axis=0))
    back = np.linalg.inv(root)
    over = np.swapaxes(back, 1, 2)
    squared, shapes = np.linalg.eigh(back @ springs @ over)
    shapes = over @ shapes
    linear = np.swapaxes(base_from_tool[:, :3, :3], 1, 2) @ slope[:, :3] / MM
    if len(modes.damping) == 1:
        damping = 2 * modes.damping[0] * np.sqrt(np.maximum(squared, 0.0))[:, :, None] * np.eye(6)
    else:
        damping = np.swapaxes(shapes, 1, 2) @ (modes.damping[:, None] * shapes)
    return _with_tool(Dynamics(squared[:, :, None] * np.eye(6), damping, linear @ shapes), modes.tool)


def _with_tool(robot: Dynamics, tool: ToolMode | None) -> Dynamics:
    if tool is None:
        return robot
    k = len(robot.shape)
    w = 2 * np.pi * tool.frequency_hz
    stiffness, damping, shape = np.zeros((k, 8, 8)), np.zeros((k, 8, 8)), np.zeros((k, 3, 8))
    stiffness[:, :6, :6], damping[:, :6, :6], shape[:, :, :6] = robot
    for i in (6, 7):
        stiffness[:, i, i], damping[:, i, i] = w**2, 2 * tool.damping_ratio * w
        shape[:, i - 6, i] = w / np.sqrt(tool.stiffness_n_per_um * 1e6)
    return Dynamics(stiffness, damping, shape)
