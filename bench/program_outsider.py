"""An outsider drives programs in fine steps: its own kinematics, arcs, corners and shapes, by numpy and coal.

Nothing of `workbench.robot` but the cell's description is used. Many programs are driven side by side: at each step one
Newton iteration holds for all of them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
from scipy.spatial.transform import Rotation

from workbench.geometry.poses import pose_from
from workbench.robot import Cell
from workbench.robot.cell_model import ON_TURNTABLE, Shape
from workbench.robot.collision import borne_doubtfully
from workbench.units import Bool, Float, Int

STEP_MM, STEP_DEG = 0.5, 0.2
JUMP = np.radians(15)
CLOSE_MM, CLOSE_RAD, ROUNDS = 1e-5, 1e-8, 20  # of Newton
ROUNDING_MM, ROUNDING_RAD = 2e-3, 1e-5  # of a program's digits, for promises


@dataclass
class Target:
    """Where a random move leads."""

    kind: str
    pose: Float  # (4, 4) of the tip in the base
    via: Float | None
    joints: Float | None
    table: Float | float  # deg, of the external axis; tilt and turntable (2,)
    zone: float


Pairs = list[tuple[int, int]]
Program = tuple[Float, Float | float, list[Target]]  # first joint angles, first external angles in deg, targets


@dataclass
class Track:
    """The places of one program."""

    pose: Float  # (n, 4, 4) of the tip; NaN on joint moves
    joints: Float  # (n, 6) end of joint moves; NaN elsewhere
    share: Float  # (n,) of a joint move
    leg: Int  # (n,)
    table: Float  # (n,) or (n, 2) deg


class Outsider:
    """One robot, its tool, and programs to drive."""

    def __init__(self, urdf: Path, cell: Cell) -> None:
        joints = [one for one in ElementTree.parse(urdf).getroot().iter("joint") if one.get("type") == "revolute"]
        self.origin = np.array([_origin(one) for one in joints])
        self.axis = np.array([_numbers(one.find("axis"), "xyz") for one in joints])
        limits = [one.find("limit") for one in joints]
        self.low, self.high = (np.array([float(one.get(key)) for one in limits]) for key in ("lower", "upper"))
        (flange,) = [one for one in ElementTree.parse(urdf).getroot().iter("joint") if _child(one) == "tool0"]
        self.tip = _origin(flange) @ cell.flange_from_cutter
        self.at_zero = self.links(np.zeros((1, 6)))[0]
        slides = cell.turntable is not None and cell.turntable.slides
        self.floor = cell.turntable.base_from_turntable[:3, 2] if slides else np.zeros(3)  # goes so, a mm of the track

    def links(self, q: Float) -> Float:
        """Poses (n, 7, 4, 4) of the base and six links."""
        poses = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
        for i in range(6):
            turn = np.zeros((len(q), 4, 4))
            turn[:, 3, 3] = 1.0
            turn[:, :3, :3] = Rotation.from_rotvec(q[:, i, None] * self.axis[i]).as_matrix()
            poses.append(poses[-1] @ self.origin[i] @ turn)
        return np.stack(poses, axis=1)

    def drive(self, programs: Sequence[Program]) -> list[tuple[str, Float, Float]]:
        """What is wrong with each program's joints ('' nothing), joint angles (n, 6), turntable angles (n,) in deg."""
        firsts = np.array([program[0] for program in programs]).reshape(-1, 6)
        tips = self.links(firsts)[:, 6] @ self.tip
        if self.floor.any():
            tips[:, :3, 3] -= np.array([[program[1]] for program in programs]).reshape(-1, 1) * self.floor
        tracks = [track(at, *program[1:]) for at, program in zip(tips, programs, strict=True)]
        for one in tracks if self.floor.any() else ():  # targets stand on the floor
            one.pose[:, :3, 3] += one.table[:, None] * self.floor
        longest = max((len(one.leg) for one in tracks), default=0)
        wrong, q, leg_start = np.full(len(tracks), "", object), firsts.copy(), firsts.copy()
        driven = np.full((len(tracks), longest, 6), np.nan)
        leg = np.zeros(len(tracks), int)
        for t in range(longest):
            going = np.array([t < len(one.leg) for one in tracks]) & (wrong == "")
            rows = np.flatnonzero(going)
            if not len(rows):
                break
            here = np.array([tracks[i].leg[t] for i in rows])
            fresh = rows[here != leg[rows]]
            leg_start[fresh], leg[rows] = q[fresh], here
            end, share = np.array([tracks[i].joints[t] for i in rows]), np.array([tracks[i].share[t] for i in rows])
            found = leg_start[rows] + share[:, None] * (end - leg_start[rows])
            space = np.isnan(found[:, 0])
            pose = np.array([tracks[i].pose[t] for i in rows[space]])
            found[space] = self._follow(q[rows[space]], pose) if space.any() else found[space]
            lost = np.isnan(found[:, 0])
            jumps = np.abs(found - q[rows]).max(axis=1) > JUMP
            beyond = ((found < self.low) | (found > self.high)).any(axis=1)
            wrong[rows] = np.where(lost, "unreachable", np.where(jumps, "jump", np.where(beyond, "limit", "")))
            q[rows[~lost]] = found[~lost]
            driven[rows, t] = found
        return [(str(wrong[i]), driven[i, : len(one.leg)], one.table) for i, one in enumerate(tracks)]

    def _follow(self, q: Float, pose: Float) -> Float:
        """Newton from the postures before (n, 6) to the tip's poses (n, 4, 4); NaN where it finds no way."""
        q, open_ = q.copy(), np.ones(len(q), bool)
        for _ in range(ROUNDS):
            rows = np.flatnonzero(open_)
            links = self.links(q[rows])
            now = links[:, 6] @ self.tip
            away = pose[rows, :3, 3] - now[:, :3, 3]
            turn = pose[rows, :3, :3] @ np.swapaxes(now[:, :3, :3], 1, 2)
            turn = (turn - np.swapaxes(turn, 1, 2))[:, [2, 0, 1], [1, 2, 0]] / 2
            near = (np.abs(away).max(axis=1) < CLOSE_MM) & (np.abs(turn).max(axis=1) < CLOSE_RAD)
            open_[rows[near]] = False
            if near.all():
                break
            axes = np.einsum("nijk,ik->nij", links[:, 1:, :3, :3], self.axis)
            arms = now[:, None, :3, 3] - links[:, 1:, :3, 3]
            j = np.concatenate([np.cross(axes, arms) / 1000, axes], axis=2)  # rows: joints
            error = np.concatenate([away / 1000, turn], axis=1)
            square = np.einsum("nia,nja->nij", j, j) + 1e-14 * np.eye(6)
            step = np.linalg.solve(square, np.einsum("nia,na->ni", j, error)[..., None])[..., 0]
            q[rows] += np.where(near[:, None], 0.0, np.clip(step, -0.2, 0.2))
        q[open_] = np.nan
        return q

    def _bodies(self, cell: Cell, joints: Float, tables: Float, within_mm: float) -> tuple[Float, Pairs, Bool]:
        """Poses (n, S, 4, 4) of the shapes; pairs that may hit; which (n, P) may be so near to each other."""
        links, shapes = self.links(joints), cell.shapes
        poses = np.empty((len(joints), len(shapes), 4, 4))
        standing, carried = list[Float](), np.eye(4)  # on each external axis, from the base outwards
        for axis, values in zip(cell.axes, tables.reshape(len(joints), -1).T, strict=False):
            at_zero, goes = axis.base_from_turntable, np.tile(np.eye(4), (len(joints), 1, 1))
            if self.floor.any():
                goes[:, :3, 3] = values[:, None] * self.floor
            else:  # about a line in the base, where it is with all axes at 0
                goes[:, :3, :3] = Rotation.from_rotvec(np.radians(values)[:, None] * at_zero[:3, 2]).as_matrix()
                goes[:, :3, 3] = at_zero[:3, 3] - goes[:, :3, :3] @ at_zero[:3, 3]
            carried = carried @ goes
            standing.append(carried @ at_zero)
        for s, shape in enumerate(shapes):
            link = max(shape.link, 0)
            on_arm = link < ON_TURNTABLE
            own = links[:, link] @ np.linalg.inv(self.at_zero[link]) if on_arm else standing[ON_TURNTABLE - 1 - link]
            poses[:, s] = own @ shape.pose
        told = {pair for pair, text in borne_doubtfully(cell).items() if text in cell.unchecked}  # not driven
        every = {(a, b) for a in range(len(shapes)) for b in range(a + 1, len(shapes))} - told
        pairs = [two for two in sorted(every) if self._may_hit(cell, *two)]
        one, other = np.array(pairs).T
        around = np.array([np.linalg.norm(_half(shape)) for shape in shapes])  # of spheres about them
        middle = poses[..., :3, 3]
        gap = np.linalg.norm(middle[:, one] - middle[:, other], axis=2)
        return poses, pairs, gap - around[one] - around[other] <= within_mm

    def _may_hit(self, cell: Cell, a: int, b: int) -> bool:
        """Whether an axis moves two shapes against each other, and not by turning one of them within itself.

        Links that share a joint meet at it. An axis' own body is borne where it meets what carries it all around, as
        deep along the axis everywhere, or where one of the two is round about it.
        """
        one, other = cell.shapes[a], cell.shapes[b]
        between = _under(one, len(cell.axes)) ^ _under(other, len(cell.axes))
        if len(between) != 1:
            return bool(between)
        kind, number = between.pop().split()
        if kind == "external" and self.floor.any():
            return True
        if kind == "joint" and min(one.link, other.link) >= 0 and not {one.body, other.body} & {"tool", "cutter"}:
            return False
        line = cell.axes[int(number)].base_from_turntable if kind == "external" else self._line(int(number))
        own = {"tool", "cutter"} if kind == "joint" else {cell.axes[int(number)].name}
        seen = [(np.linalg.inv(line) @ _at_zero(cell, shape), shape) for shape in (one, other)]
        fixed = any(_round_about_z(*two) for two in seen) or _borne_all_around_z(*seen)
        return not ({one.body, other.body} & own and fixed)

    def _line(self, joint: int) -> Float:
        """A frame (4, 4) whose z is a joint's axis, all joints at 0."""
        frame = self.at_zero[joint + 1].copy()
        turn, _ = Rotation.align_vectors(self.axis[joint], [0, 0, 1])
        frame[:3, :3] = frame[:3, :3] @ turn.as_matrix()
        return frame

    def least(self, cell: Cell, joints: Float, tables: Float, within_mm: float) -> tuple[float, str]:
        """The least distance of all bodies, if it is less than `within_mm`, and whose; 0: they touch."""
        poses, pairs, near = self._bodies(cell, joints, tables, within_mm)
        solids = [_solid(shape) for shape in cell.shapes]
        best, names = np.inf, ""
        for n, p in zip(*np.nonzero(near), strict=True):
            i, j = pairs[p]
            distance = _apart(solids[i], poses[n, i], solids[j], poses[n, j])
            if distance < best:
                best, names = distance, f"{cell.shapes[i].body} and {cell.shapes[j].body}"
            if distance == 0.0:
                break
        return best, names

    def unsafe(self, cell: Cell, joints: Float, tables: Float) -> str:
        """What is wrong with the bodies and the turntable; '' nothing."""
        for axis, values in zip(cell.axes, tables.reshape(len(tables), -1).T, strict=False):
            low, high = np.degrees(axis.limits)
            if values.min() < low or values.max() > high:
                return f"limit of the {axis.name}"
        distance, names = self.least(cell, joints, tables, 0.0)
        return names if distance <= 0 else ""

    def broken(self, cell: Cell, joints: Float, tables: Float, clearance_mm: float, limit_margin: float) -> str:
        """A place where bodies are nearer than the judge said, or a joint nearer to its limit; '' nowhere."""
        room = np.minimum(joints - self.low, self.high - joints).min()
        if room < limit_margin - ROUNDING_RAD:
            return f"{np.degrees(room):.4f} deg from a limit, said {np.degrees(limit_margin):.4f}"
        distance, names = self.least(cell, joints, tables, clearance_mm)
        return f"{names}: {distance:.4f} mm, said {clearance_mm:.4f}" if distance < clearance_mm - ROUNDING_MM else ""


def track(tip: Float, table: Float | float, targets: list[Target]) -> Track:
    """All places of a program in fine steps, from the tip's first pose on."""
    starts = [tip, *(target.pose for target in targets[:-1])]
    angles = [table, *(target.table for target in targets)]
    lengths = [_length(start, target) for start, target in zip(starts, targets, strict=True)]
    cuts = [[0.0, 1.0] for _ in targets]
    for i in range(len(targets) - 1):
        if targets[i].zone > 0 and "J" not in (targets[i].kind, targets[i + 1].kind):
            zone = min(targets[i].zone, lengths[i] / 2, lengths[i + 1] / 2)
            cuts[i][1], cuts[i + 1][0] = 1 - zone / lengths[i], zone / lengths[i + 1]
    poses, joints, shares, legs, tables = [], [], [], [], []

    def add(pose: Float, joint: Float, share: Float, angle: Float) -> None:
        legs.append(np.full(len(share), len(legs) + 1))
        for column, value in zip((poses, joints, shares, tables), (pose, joint, share, angle), strict=True):
            column.append(value)

    for i, target in enumerate(targets):
        a, b = angles[i], angles[i + 1]
        if target.joints is not None:
            f = np.linspace(0, 1, 120)  # a random joint move turns a joint by some 20 deg
            nowhere, external = np.full((len(f), 4, 4), np.nan), a + np.multiply.outer(f, b - a)
            add(nowhere, np.tile(target.joints, (len(f), 1)), f, external)
            continue
        turn = (Rotation.from_matrix(starts[i][:3, :3]).inv() * Rotation.from_matrix(target.pose[:3, :3])).magnitude()
        steps = max(lengths[i] / STEP_MM, np.degrees(turn) / STEP_DEG, np.abs(b - a).max() / STEP_DEG)
        f = np.linspace(*cuts[i], int(steps) + 2)
        nothing = np.full((len(f), 6), np.nan)
        add(_on(starts[i], target, f), nothing, f, a + np.multiply.outer(f, b - a))
        if cuts[i][1] < 1:
            begin = _on(starts[i], target, np.array(cuts[i][1:]))[0]
            end = _on(target.pose, targets[i + 1], np.array(cuts[i + 1][:1]))[0]
            v = np.linspace(0, 1, int(2 * target.zone / STEP_MM) + 3)
            before, behind = a + cuts[i][1] * (b - a), b + cuts[i + 1][0] * (angles[i + 2] - b)
            bent = _bent(before, b, behind, v.reshape(-1, *[1] * np.ndim(b)))
            add(_corner(begin, target.pose, end, v), np.full((len(v), 6), np.nan), v, np.asarray(bent))
    return Track(*(np.concatenate(column) for column in (poses, joints, shares, legs, tables)))


def _bent(a: Any, b: Any, c: Any, v: Any) -> Any:
    return (1 - v) ** 2 * a + 2 * v * (1 - v) * b + v * v * c


def _between(a: Rotation, b: Rotation, f: Float) -> Rotation:
    """From a to b, a share f (n,) of the way."""
    return a * Rotation.from_rotvec(f[:, None] * (a.inv() * b).as_rotvec())


def _corner(a: Float, corner: Float, b: Float, v: Float) -> Float:
    poses = np.tile(np.eye(4), (len(v), 1, 1))
    poses[:, :3, 3] = _bent(a[:3, 3], corner[:3, 3], b[:3, 3], v[:, None])
    turns = [Rotation.from_matrix(one[:3, :3]) for one in (a, corner, b)]
    poses[:, :3, :3] = _between(_between(*turns[:2], v), _between(*turns[1:], v), v).as_matrix()
    return poses


def _on(start: Float, target: Target, f: Float) -> Float:
    """Places (n, 4, 4) on a whole move."""
    poses = np.tile(np.eye(4), (len(f), 1, 1))
    ends = Rotation.from_matrix(start[:3, :3]), Rotation.from_matrix(target.pose[:3, :3])
    poses[:, :3, :3] = _between(*ends, np.clip(f, 0, 1)).as_matrix()
    a, b = start[:3, 3], target.pose[:3, 3]
    poses[:, :3, 3] = a + f[:, None] * (b - a)
    if target.via is not None:
        centre, axis, sweep = _circle(a, target.via[:3, 3], b)
        poses[:, :3, 3] = centre + Rotation.from_rotvec(f[:, None] * sweep * axis).apply(a - centre)
    return poses


def _circle(a: Float, via: Float, b: Float) -> tuple[Float, Float, float]:
    """Three planes meet in the centre."""
    axis = np.cross(via - a, b - a)
    axis /= np.linalg.norm(axis)
    planes = np.array([via - a, b - a, axis])
    centre = np.linalg.solve(planes, [(via - a) @ (via + a) / 2, (b - a) @ (b + a) / 2, axis @ a])
    u, v = a - centre, b - centre
    return centre, axis, float(np.arctan2(np.cross(u, v) @ axis, u @ v) % (2 * np.pi))


def _length(start: Float, target: Target) -> float:
    if target.via is None:
        return float(np.linalg.norm(target.pose[:3, 3] - start[:3, 3]))
    centre, _, sweep = _circle(start[:3, 3], target.via[:3, 3], target.pose[:3, 3])
    return float(np.linalg.norm(start[:3, 3] - centre) * sweep)


def _under(shape: Shape, externals: int) -> set[str]:
    """The axes that carry a shape."""
    if shape.link < ON_TURNTABLE:
        return {f"joint {i}" for i in range(shape.link)}
    return {f"external {i}" for i in range(externals - (shape.link - ON_TURNTABLE))}


def _round_about_z(seen: Float, shape: Shape) -> bool:
    """Whether a shape, `seen` (4, 4) in a frame, turned about its z fills the same space."""
    upright = shape.kind == "sphere" or (shape.kind in ("capsule", "cylinder") and np.hypot(*seen[:2, 2]) < 1e-6)
    return bool(upright and np.hypot(*seen[:2, 3]) < 1e-3)


def _borne_all_around_z(first: tuple[Float, Shape], second: tuple[Float, Shape]) -> bool:
    """Whether two shapes touch wherever the first is turned to about z, and one lift along it frees it everywhere.

    In steps of 15 deg, to 1 mm.
    """
    (one, shape), (other, against) = first, second
    solids = _solid(shape), _solid(against)
    turns = Rotation.from_euler("z", np.arange(0, 360, 15)[:, None], degrees=True).as_matrix()

    def touch(turn: Float, lift: float) -> bool:
        moved = pose_from(turn @ one[:3, :3], turn @ one[:3, 3] + [0, 0, lift])
        return _apart(solids[0], moved, solids[1], other) == 0.0

    def frees(way: int) -> bool:
        held, free = 0.0, 2.0 * float(np.linalg.norm(_half(shape)) + np.linalg.norm(_half(against)))
        while free - held > 0.1:
            middle = (held + free) / 2
            held, free = (middle, free) if touch(turns[0], way * middle) else (held, middle)
        deeper = held < 1 or all(touch(turn, way * (held - 1)) for turn in turns)
        return deeper and not any(touch(turn, way * (free + 1)) for turn in turns)

    return all(touch(turn, 0.0) for turn in turns) and any(map(frees, (-1, 1)))


def _at_zero(cell: Cell, shape: Shape) -> Float:
    """Pose (4, 4) in the base, all axes at 0."""
    if shape.link < ON_TURNTABLE:
        return shape.pose
    return cell.axes[ON_TURNTABLE - 1 - shape.link].base_from_turntable @ shape.pose


def _half(shape: Shape) -> Float:
    if shape.kind == "box":
        return np.array(shape.size_mm) / 2
    radius, length = shape.size_mm[0], (*shape.size_mm, 0.0)[1]
    return np.array([radius, radius, length / 2 + (radius if shape.kind != "cylinder" else 0.0)])


def _apart(solid: Any, pose: Float, other: Any, its_pose: Float) -> float:
    """Least distance of two solids; 0 where they touch."""
    at, its_place = (coal.Transform3s(one[:3, :3], one[:3, 3]) for one in (pose, its_pose))
    return max(0.0, float(coal.distance(solid, at, other, its_place, coal.DistanceRequest(), coal.DistanceResult())))


def _solid(shape: Shape) -> Any:
    makers = {"box": coal.Box, "sphere": coal.Sphere, "capsule": coal.Capsule, "cylinder": coal.Cylinder}
    return makers[shape.kind](*shape.size_mm)


def _child(joint: ElementTree.Element) -> str:
    element = joint.find("child")
    return "" if element is None else element.get("link", "")


def _numbers(element: ElementTree.Element | None, key: str) -> Float:
    return np.array([float(x) for x in ("" if element is None else element.get(key, "")).split() or (0, 0, 0)])


def _origin(joint: ElementTree.Element) -> Float:
    pose, origin = np.eye(4), joint.find("origin")
    pose[:3, :3] = Rotation.from_euler("xyz", _numbers(origin, "rpy")).as_matrix()
    pose[:3, 3] = 1e3 * _numbers(origin, "xyz")
    return pose
