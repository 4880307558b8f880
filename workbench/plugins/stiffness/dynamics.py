"""The robot in motion: mass of rigid links, springs and dampers about the joints, and what that is at the tool."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

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
    mapped,
    motions,
)
from workbench.plugins.stiffness.elastic import MM, PER_M, geometric_stiffness
from workbench.plugins.stiffness.stability import Dynamics
from workbench.plugins.stiffness.values import RobotModes


def bodies_of(cell: Cell, masses_kg: Sequence[float] | None) -> Bodies:
    """Masses of the links with the tool on the sixth: as the URDF has them, or even within the links' shapes.

    Raises:
        InputError: the URDF states none and none are given; a link without a shape.
    """
    import pinocchio as pin

    bodies = cell.chain.bodies
    if masses_kg is not None:
        each = _even(cell, masses_kg)
    elif bodies is not None:
        of_urdf = zip(bodies.mass_kg, bodies.centre_mm / MM, bodies.inertia_kg_m2, strict=True)
        each = [pin.Inertia(*one) for one in of_urdf]
    else:
        raise InputError(
            cell.source,
            "expected <inertial> with a mass for every link in the URDF, found none: give link_masses_kg (1,280 kg in "
            "all is an IRB 6700's), or tap tests to scale them",
        )
    if cell.tool_mass_kg is not None:
        flange, at = cell.chain.base_from_flange_at_zero, cell.tool_centre_of_gravity_mm
        solids = [_solid(one) for one in cell.shapes if one.link == 6 and one.body == "tool"]
        tool = (
            _filled(solids, cell.tool_mass_kg)
            if solids
            else pin.Inertia(cell.tool_mass_kg, flange[:3, 3] / MM, np.zeros((3, 3)))
        )
        if at is not None:
            tool.lever = mapped(flange, at) / MM
        each[5] = each[5] + tool
    mass, lever, inertia = (np.array([getattr(one, name) for one in each]) for name in ("mass", "lever", "inertia"))
    return Bodies(mass, lever * MM, inertia)


def _even(cell: Cell, masses_kg: Sequence[float]) -> list[Any]:
    """Inertias of masses spread evenly in the shapes of each link."""
    found = []
    for link, mass in enumerate(masses_kg, 1):
        others = ("tool", "cutter", "workpiece")
        solids = [_solid(one) for one in cell.shapes if one.link == link and one.body not in others]
        if not solids:
            where = f"expected a collision shape of link {link} to spread its mass in, found none"
            raise InputError(cell.source, where)
        found.append(_filled(solids, mass))
    return found


def _filled(solids: Sequence[Any], mass_kg: float) -> Any:
    """A mass spread evenly in solids."""
    import pinocchio as pin

    whole = sum(solids[1:], solids[0])
    return pin.Inertia(mass_kg, whole.lever, whole.inertia * mass_kg / whole.mass)


def _solid(shape: Shape) -> Any:
    """Inertia (pinocchio's) of a shape of 1 kg a cubic metre, base axes, m; a mesh must be closed."""
    import pinocchio as pin

    if shape.vertices_mm is None or shape.triangles is None:
        made = getattr(pin.coal, shape.kind.capitalize())(*(np.array(shape.size_mm) / MM))
    else:
        made = pin.coal.BVHModelOBBRSS()
        made.beginModel(len(shape.triangles), len(shape.vertices_mm))
        made.addVertices(shape.vertices_mm / MM)
        made.addTriangles(shape.triangles)
        made.endModel()
    volume = made.computeVolume()  # below 0 where triangles are seen from within
    own = pin.Inertia(abs(volume), made.computeCOM(), np.sign(volume) * made.computeMomentofInertiaRelatedToCOM())
    return pin.SE3(shape.pose[:3, :3], shape.pose[:3, 3] / MM).act(own)


def mass_matrix(chain: Chain, bodies: Bodies, joints: Shaped[Float, "k 6"]) -> Shaped[Float, "k 6 6"]:
    """Of the links about the joints, kg m^2."""
    axes, points = joint_axes(chain, joints)
    moved = motions(chain, joints)
    whole = np.zeros((len(joints), 6, 6))
    for link in range(6):
        at = moved[:, link + 1]
        slope = jacobian_at(axes, points, mapped(at, bodies.centre_mm[link])) / PER_M[:, None]
        slope[:, :, link + 1 :] = 0.0
        inertia = np.zeros((len(joints), 6, 6))
        inertia[:, :3, :3] = bodies.mass_kg[link] * np.eye(3)
        inertia[:, 3:, 3:] = at[:, :3, :3] @ bodies.inertia_kg_m2[link] @ at[:, :3, :3].mT
        whole += slope.mT @ inertia @ slope
    return whole


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
        own = geometric_stiffness(jacobian_derivative(slope), wrench)
        springs = springs - (own + own.mT) / 2
    root = np.linalg.cholesky(mass_matrix(chain, modes.bodies, joints))
    back = np.linalg.inv(root)
    over = back.mT
    squared, shapes = np.linalg.eigh(back @ springs @ over)
    shapes = over @ shapes
    linear = base_from_tool[:, :3, :3].mT @ slope[:, :3] / MM
    if len(modes.damping) == 1:
        damping = 2 * modes.damping[0] * np.sqrt(np.maximum(squared, 0.0))[:, :, None] * np.eye(6)
    else:
        damping = shapes.mT @ (modes.damping[:, None] * shapes)
    robot, tool = Dynamics(squared[:, :, None] * np.eye(6), damping, linear @ shapes), modes.tool
    if tool is None:
        return robot
    w, more = 2 * np.pi * tool.frequency_hz, np.diag(np.repeat([0.0, 1.0], [6, 2]))
    stiffness, damping = (np.pad(part, ((0, 0), (0, 2), (0, 2))) for part in robot[:2])
    shape = np.pad(robot.shape, ((0, 0), (0, 0), (0, 2)))
    shape[:, [0, 1], [6, 7]] = w / np.sqrt(tool.stiffness_n_per_um * 1e6)
    return Dynamics(stiffness + w**2 * more, damping + 2 * tool.damping_ratio * w * more, shape)
