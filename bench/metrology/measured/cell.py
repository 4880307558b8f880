"""How the paper's robot gives way under the milling force, at a posture of its table A1."""

from __future__ import annotations

import functools

import numpy as np

from bench.metrology.run import ROOT
from workbench.api import forward_kinematics, jacobian_at, joint_axes
from workbench.artefacts import Engagement, PathDeflection, Toolpath
from workbench.plugins.stiffness.force import force
from workbench.plugins.stiffness.values import TABLE_2_NM_PER_RAD
from workbench.robot import read_cell
from workbench.units import DEG, Float

MM = 1000.0
POSTURE_DEG = (0.0, -3.0, 5.0, 45.0, -45.0, 225.0)  # the first of the paper's table A1, as ABB counts


def give_way(path: Toolpath, engagement: Engagement, seed: int) -> PathDeflection:
    """Displacement of the tool in its own frame by the mean force of a revolution, the cell turned at random."""
    force_now, _ = force(path, engagement)
    compliance = _compliance(seed)
    return PathDeflection({layer.index: layer.mean_n @ compliance.T for layer in force_now.layers})


def _compliance(seed: int) -> Float:
    """mm/N (3, 3) in the tool's frame: J K^-1 J^T, turned about the cutter's axis by any angle."""
    angle = np.random.default_rng([seed, 0xCE11]).uniform(0.0, 2.0 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    return np.asarray(turn.T @ _at_posture() @ turn)


@functools.cache
def _at_posture() -> Float:
    cell = read_cell(ROOT / "data" / "robot" / "cell.json")
    joints = np.array([POSTURE_DEG]) * DEG
    cutter = (forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter)[0]
    jacobian = cutter[:3, :3].T @ jacobian_at(*joint_axes(cell.chain, joints), cutter[None, :3, 3])[0, :3]
    return np.asarray(jacobian @ np.diag(1.0 / np.array(TABLE_2_NM_PER_RAD)) @ jacobian.T / MM)
