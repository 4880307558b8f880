"""The program as written, played in the report's viewer: robot, tool, plate and what stands around, place by place."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Judgement, Scene
from workbench.geometry.poses import inverse
from workbench.robot.bounds import CollisionScreen
from workbench.robot.cell_model import Cell
from workbench.robot.collision import base_from_targets, standing_poses
from workbench.robot.drawing import WAY, body_edges, drawn
from workbench.robot.kinematics import forward_kinematics, motions

FRAMES = 600  # that are shown at most, spread evenly over the places at which the judge looked first


def playback(judgement: Judgement, cell: Cell) -> Scene | None:
    """The scene of a program that was driven; None: it was not, or reaches nowhere."""
    driven = judgement.driven
    if not driven:
        return None
    reached = np.flatnonzero(np.isfinite(driven["joints"]).all(axis=1))
    at = reached[np.unique(np.linspace(0, len(reached) - 1, min(FRAMES, len(reached))).astype(int))]
    if not len(at):
        return None
    joints, table = driven["joints"][at], driven["turntable"][at]
    floor = inverse(base_from_targets(cell, table))
    links = np.swapaxes(floor[:, None] @ motions(cell.chain, joints), 0, 1)
    moved = [*links, *(floor @ standing_poses(cell, table))]  # by `Shape.link`
    clearance = CollisionScreen(cell).clearances_mm(joints, table)
    said = tuple(
        f"line {line:.0f} · {time_s:.1f} s · {mm_s:.3g} mm/s"
        + (f" · clearance {near:.1f} mm" if np.isfinite(near) else "")
        for line, time_s, mm_s, near in zip(
            *(driven[name][at].tolist() for name in ("line", "time_s", "mm_s")), clearance.tolist(), strict=True
        )
    )
    tip = (floor @ forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter)[:, :3, 3]
    strokes = [drawn(name, lines, name, moved=moved[max(link, 0)]) for (name, link), lines in body_edges(cell).items()]
    strokes += [drawn(WAY, [tip], WAY)] if len(tip) > 1 else []
    return Scene(np.zeros((0, 3)), (), tuple(strokes), (), np.eye(3), "places", ("x", "y", "z"), said)
