"""Whether a robot leads its scanner along a pass: postures with margins, free rays, no collision.

Kinematics and bodies are the cell's (`workbench.robot`); distances are python-fcl's.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from workbench.errors import InputError
from workbench.extras import Extra
from workbench.geometry.blocks import evenly
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import frame_about, inverse, pose_from
from workbench.result_files import SensorFile
from workbench.robot import (
    Cell,
    CollisionScreen,
    dexterity,
    forward_kinematics,
    inverse_kinematics,
    standing_poses,
    turntable_pose,
    within_limits,
)
from workbench.robot.bounds import FREE
from workbench.robot.cell_model import ON_BASE, ON_CRADLE, ON_TURNTABLE, Shape
from workbench.robot.collision import body_of, outermost
from workbench.robot.drawing import shape_triangles
from workbench.robot.plate_stage import scanned
from workbench.scan_plan.information import Joint
from workbench.scan_plan.way import EdgeLine
from workbench.units import Bool, Float, Shaped

fcl = Extra("fcl")

PLATE_MM = 150.0  # of the plate behind its edge that is a body to run into
PIECE_MM = 50.0  # of a curved edge, that a box of the plate follows
RAY_MM = 0.5  # radius of a ray that must be free
RAY_MARGIN_MM = 2.0  # of a ray's ends and sides, where a body's box counts as near
GENTLE, LEAST = 0.8, 1e-6  # share of what a joint can do, that a pass may ask for; s/mm
MOST_TURN = 0.35  # rad, of a joint between two stations
VOXEL_MM = 4.0
BODY, SURROUNDINGS = "workpiece", "seen beside the plate"
BESIDE_MM, ON_PLATE_MM = 10.0, 3.0  # off the edge, where its side is looked up; a place on the mesh's plate, from it


class Reached(NamedTuple):
    """How the robot stands along a pass, at k stations."""

    joints: Shaped[Float, "k 6"]  # rad
    half_turn: bool  # the scanner by half a turn about its rays
    fastest_mm_s: float  # that the joints follow


class Examiner:
    """The bodies of a cell whose tool is the scanner, ready to be asked about many passes."""

    def __init__(self, cell: Cell) -> None:
        """Build once, ask often."""
        self.cell, self.screen = cell, CollisionScreen(cell)
        self.rays = [
            (shape, fcl.CollisionObject(body_of(shape)))
            for shape in cell.shapes
            if not 0 <= shape.link <= 6 and shape.body not in (BODY, "envelope")
        ]
        corners = [shape_triangles(shape).reshape(-1, 3) for shape, _ in self.rays]
        self.boxes = [np.stack([one.min(axis=0), one.max(axis=0)]) for one in corners]  # each in the shape's frame
        self.on_base = frozenset(shape.body for shape, _ in self.rays if shape.link == ON_BASE)

    def reach(self, base_from_view: Float, orientations: Sequence[Float], table: float) -> Reached | str:
        """Postures along poses (k, 4, 4) of a part that stands as planned, the turntable at `table`; or why not.

        orientations: the same poses as they are and, if that is tried too, by half a turn about the rays.
        """
        move = turntable_pose(self.cell, table) @ inverse(turntable_pose(self.cell, 0.0))
        back = inverse(self.cell.flange_from_cutter)
        found: list[tuple[float, bool, Float]] = []
        why = "out of the robot's reach"
        for number, poses in enumerate(orientations):
            branches = within_limits(self.cell.chain, inverse_kinematics(self.cell.chain, move @ poses @ back))
            for joints in _followed(branches):
                if np.isnan(joints).any():
                    continue
                margin, fault = self._margin(joints)
                if fault:
                    why = fault
                    continue
                found.append((margin, bool(number), joints))
        angles = outermost(self.cell, np.full(len(base_from_view), table))
        for _, half, joints in sorted(found, key=lambda one: -one[0]):
            few = evenly(len(joints), 3)
            hits = self.screen.hits(joints[few], angles[few])
            if (hits == FREE).all():
                hits = self.screen.hits(joints, angles)
            if (hits == FREE).all():
                return Reached(joints, half, self._fastest_mm_s(joints, base_from_view))
            why = "collision of " + " and ".join(self.screen.pair(int(hits[hits != FREE][0])))
        return why

    def _margin(self, joints: Float) -> tuple[float, str]:
        """Least distance from a limit, rad, and what is wrong with postures (k, 6); '': nothing."""
        cell = self.cell
        tip = forward_kinematics(cell.chain, joints) @ self.cell.flange_from_cutter
        wrist, condition, asked = dexterity(cell.chain, joints, tip[:, :3, 3], cell.margins.twist)
        low, high = cell.chain.limits.T
        room = np.minimum(joints - low, high - joints) - asked
        if room.min() < cell.margins.limit:
            return 0.0, f"joint {int(room.min(axis=0).argmin()) + 1} too near to its limit"
        if wrist.min() < cell.margins.wrist or condition.max() > cell.margins.condition:
            return 0.0, "a singular posture"
        return float(room.min()), ""

    def _fastest_mm_s(self, joints: Float, base_from_view: Float) -> float:
        """At which no joint takes more than `GENTLE` of its speed, or of its acceleration where that is stated."""
        step = chords_mm(base_from_view[:, :3, 3])[:, None]
        a_mm = np.diff(joints, axis=0) / step
        bend = np.diff(a_mm, axis=0) / (0.5 * (step[1:] + step[:-1]))
        most = np.full(6, np.inf) if self.cell.accelerations is None else self.cell.accelerations
        asked = float((np.abs(a_mm) / self.cell.chain.speeds).max()), math.sqrt((np.abs(bend) / most).max(initial=0.0))
        return GENTLE / max(*asked, LEAST)

    def shadows(self, point_mm: Shaped[Float, "k p 3"], eye_mm: Shaped[Float, "k e 3"], table: float) -> list[str]:
        """Body in the way between points of each station's section and what looks at them, all as planned; '': none.

        Bodies on the turntable go with the part; those on the base are turned back.
        """
        at_zero = turntable_pose(self.cell, 0.0)
        back = at_zero @ inverse(turntable_pose(self.cell, table))
        carriers = {ON_TURNTABLE: at_zero, ON_CRADLE: back @ standing_poses(self.cell, 0.0)[-1]}
        start = np.repeat(point_mm, eye_mm.shape[1], axis=1)
        way = np.tile(eye_mm, (1, point_mm.shape[1], 1)) - start
        near = np.empty((*way.shape[:2], len(self.rays)), bool)
        for one, (shape, body) in enumerate(self.rays):
            pose = carriers.get(shape.link, back) @ shape.pose
            body.setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
            near[..., one] = _passes((start - pose[:3, 3]) @ pose[:3, :3], way @ pose[:3, :3], self.boxes[one])
        length = np.linalg.norm(way, axis=-1)
        way /= length[..., None]
        out = [""] * len(point_mm)
        for k, ray in np.argwhere(near.any(axis=-1)).tolist():
            bodies = [self.rays[one] for one in np.flatnonzero(near[k, ray])]
            out[k] = out[k] or _blocked(start[k, ray], way[k, ray], float(length[k, ray]), bodies)
        return out


def _passes(start: Float, way: Float, box: Shaped[Float, "2 3"]) -> Bool:
    """Whether ways (..., 3) from their starts meet a box along the axes, least and greatest corner, or come near."""
    step = np.where(way == 0.0, 1e-9, way)
    near, far = ((side - start) / step for side in box + np.array([[-RAY_MARGIN_MM], [RAY_MARGIN_MM]]))
    enter, leave = np.minimum(near, far).max(axis=-1), np.maximum(near, far).min(axis=-1)
    return np.asarray((enter <= leave) & (leave >= 0.0) & (enter <= 1.0))


def _blocked(point: Float, way: Float, length: float, bodies: Sequence[tuple[Shape, Any]]) -> str:
    """The first of bodies that a ray of some length meets, from a millimetre off the face on; '': none."""
    middle = fcl.Transform(frame_about(way).T, point + 0.5 * (length + 2.0) * way)
    ray = fcl.CollisionObject(fcl.Capsule(RAY_MM, length), middle)
    for shape, body in bodies:
        if fcl.collide(ray, body, fcl.CollisionRequest(), fcl.CollisionResult()):
            return shape.body
    return ""


def _followed(branches: Shaped[Float, "k b 6"]) -> Shaped[Float, "b k 6"]:
    """Joint angles from each of the first ones on by the nearest; NaN where they end, or jump."""
    out = [branches[0]]
    for at in branches[1:]:
        away = np.abs(at - out[-1][:, None]).max(axis=2)
        near = np.where(away <= MOST_TURN, away, np.inf)
        out.append(np.where(np.isinf(near.min(axis=1))[:, None], np.nan, at[near.argmin(axis=1)]))
    return np.stack(out, axis=1)


def scan_cell(
    cell: Cell,
    sensor: SensorFile,
    flange_from_profiler: Float,
    standoff_mm: float,
    edge: EdgeLine,
    joint: Joint,
    *,
    tool_stays: bool,
    z_away: bool,
) -> Cell:
    """The cell with the scanner as its tool, the plate where it roughly is, and what stands beside it.

    The tool frame is the view at the stand-off.
    """
    at_zero = cell.chain.base_from_flange_at_zero
    sense = 1.0 if z_away else -1.0
    look = pose_from(np.diag([1.0, sense, sense]), np.array([0.0, 0.0, sense * standoff_mm]))
    own = [shape for shape in cell.shapes if shape.link == 6 and shape.body in ("tool", "cutter")]
    kept = [shape for shape in cell.shapes if tool_stays or not any(shape is one for one in own)]
    body = [
        Shape(
            "tool",
            6,
            "box",
            box.size_mm,
            at_zero @ flange_from_profiler @ pose_from(np.eye(3), np.array(box.centre_mm)),
        )
        for box in sensor.body or ()
    ]
    link = ON_BASE if cell.turntable is None else ON_TURNTABLE
    part_from_base = np.eye(4) if cell.turntable is None else inverse(turntable_pose(cell, 0.0))
    plate = [] if any(shape.body == BODY for shape in kept) else list(_plate(edge, joint, part_from_base, link))
    if edge.surroundings_mm is not None and len(edge.surroundings_mm):
        seen = scanned(edge.surroundings_mm, VOXEL_MM, link, part_from_base, edge.source)
        plate += [dataclasses.replace(shape, body=SURROUNDINGS) for shape in seen]
    return dataclasses.replace(
        cell.without_contact, shapes=(*kept, *body, *plate), flange_from_cutter=flange_from_profiler @ look
    )


def unknown_side(cell: Cell | None, edge: EdgeLine, joint: Joint) -> tuple[str, ...]:
    """Where the plate lies, if nothing but the order of taught points tells it.

    Raises:
        InputError: by the mesh of the workpiece the plate lies on their other side.
    """
    if not edge.by_order:
        return ()
    meshes = [] if cell is None else [shape for shape in cell.shapes if shape.body == BODY]
    if cell is not None and meshes:
        few = edge.at(np.linspace(0.0, edge.length_mm, 7)[1:-1])
        behind = BESIDE_MM + (joint.thickness_mm - joint.root_mm) * math.tan(joint.bevel)
        places = (
            few.position_mm + across * few.normal + height * few.across
            for across in (-behind, behind)
            for height in (joint.thickness_mm, -joint.thickness_mm)
        )
        there, *others = (_share_on(cell, meshes, one) for one in places)
        opposite = max(others)
        if opposite > there:
            why = "expected the points in the order of t = m x n, found the plate of the cell file's workpiece on"
            raise InputError(edge.source, f"{why} another side: reverse their order, or upper_side")
        if there > opposite:
            return ()
    towards = ", ".join(f"{value:.2g}" for value in -edge.normal.mean(axis=0) + 0.0)
    return (f"on which side the plate lies: by the order of the points and upper_side, towards ({towards})",)


def _share_on(cell: Cell, meshes: Sequence[Shape], places_mm: Shaped[Float, "p 3"]) -> float:
    """Share of places in the base that lie on one of the bodies."""
    ball, on = fcl.CollisionObject(fcl.Sphere(ON_PLATE_MM)), np.zeros(len(places_mm), bool)
    for shape in meshes:
        pose = shape.pose if shape.link == ON_BASE else turntable_pose(cell, 0.0) @ shape.pose
        body = fcl.CollisionObject(body_of(shape), fcl.Transform(pose[:3, :3], pose[:3, 3]))
        for k, place in enumerate(places_mm):
            ball.setTransform(fcl.Transform(np.eye(3), place))
            on[k] |= bool(fcl.collide(ball, body, fcl.CollisionRequest(), fcl.CollisionResult()))
    return float(on.mean())


def _plate(edge: EdgeLine, joint: Joint, part_from_base: Float, link: int):  # type: ignore[no-untyped-def]
    pieces = max(1, round(edge.length_mm / PIECE_MM))
    ends = np.linspace(0.0, edge.length_mm, pieces + 1)
    middle = edge.at(0.5 * (ends[1:] + ends[:-1]))
    size = (PLATE_MM, edge.length_mm / pieces, joint.thickness_mm)
    for k in range(pieces):
        n, t, m = middle.normal[k], middle.tangent[k], middle.across[k]
        at = middle.position_mm[k] - 0.5 * PLATE_MM * n + 0.5 * joint.thickness_mm * m
        pose = pose_from(np.stack([-n, -t, m], axis=1), at)
        yield Shape(BODY, link, "box", size, part_from_base @ pose)
