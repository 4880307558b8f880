"""Random programs: what the judge lets pass, driven by an outsider in fine steps. `python -m bench.programs --help`.

Each program is RAPID text: straight, circular and joint moves, rounded corners, a turntable, in a cell with random
boxes near the way. The judge sees the text. The outsider sees the numbers that the text was made from: it follows the
way by Newton steps on pinocchio's model, with corner parabolas and circles of its own, and asks fcl about shapes that
it built from the cell's description. Unsafe: a contact, a joint beyond its limit, a joint that jumps. The goal is none
among those that passed.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import fcl
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation, Slerp

from workbench.program.rapid_reader import read_rapid
from workbench.robot import Cell, forward_kinematics, read_cell
from workbench.robot.judge import judge
from workbench.robot.shapes import ON_BASE, ON_TURNTABLE, Shape
from workbench.units import Float

CELL = Path(__file__).parent.parent / "data" / "robot" / "cell.json"
STEP_MM, STEP_DEG = 0.5, 0.2  # of the outsider
UNUSED = "9E9"


@dataclasses.dataclass
class Target:
    """Where a random move leads."""

    kind: str
    pose: Float  # (4, 4) of the tip in the base
    via: Float | None
    joints: Float | None
    table: float  # deg
    zone: float


Leg = tuple[Float, Target, float]  # where it begins, where it leads, the turntable at its begin in deg


def random_program(cell: Cell, rng: np.random.Generator) -> tuple[Float, float, list[Target]]:
    """First joint angles (6,) rad, first turntable angle in deg, and targets."""
    low, high = cell.chain.limits.T
    while True:
        q = np.radians([*rng.uniform([-60, -20, -40], [60, 50, 40]), *rng.uniform([-150, -110, -150], [150, 110, 150])])
        tip = forward_kinematics(cell.chain, q) @ cell.flange_from_cutter
        if abs(q[4]) > np.radians(8) and tip[2, 3] > 250 and ((q > low) & (q < high)).all():
            break
    start, table, at = q, float(rng.uniform(-90, 90)), tip
    first_table, targets = table, list[Target]()
    heading = rng.normal(size=3)
    for _ in range(rng.integers(2, 6)):
        heading = heading / np.linalg.norm(heading) + 0.8 * rng.normal(size=3)
        pose = at.copy()
        pose[:3, 3] += heading / np.linalg.norm(heading) * rng.uniform(10, 150)
        pose[:3, :3] = at[:3, :3] @ Rotation.from_rotvec(np.radians(rng.normal(size=3) * 10)).as_matrix()
        kind, via, joints = (
            rng.choice(["L", "L", "L", "C", "J"] if targets and targets[-1].kind != "J" else ["L", "J"]),
            None,
            None,
        )
        if kind == "C":
            via = pose.copy()
            chord = pose[:3, 3] - at[:3, 3]
            across = np.cross(chord, rng.normal(size=3))
            bulge = rng.uniform(0.1, 0.4) * np.linalg.norm(chord) / np.linalg.norm(across)
            via[:3, 3] = at[:3, 3] + chord / 2 + bulge * across
        if kind == "J":
            joints = start + np.radians(rng.normal(size=6) * 12)
            pose = forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter
            targets[-1:] = [dataclasses.replace(one, zone=0.0) for one in targets[-1:]]
        table += float(rng.choice([0.0, rng.normal() * 8]))
        zone = 0.0 if kind == "J" else float(rng.choice([0.0, 0.3, rng.uniform(1, 20)]))
        targets.append(Target(str(kind), pose, via, joints, table, zone))
        at = pose
    targets[-1].zone = 0.0
    return start, first_table, targets


def rapid_text(cell: Cell, first: Float, table: float, targets: list[Target]) -> str:
    """The program as a file."""
    tool = _pose(cell.flange_from_cutter)
    lines = ["MODULE Random", f"  PERS tooldata tMill:=[TRUE,{tool},[15,[0,0,150],[1,0,0,0],0,0,0]];"]
    lines.append("  CONST speeddata feed:=[20,50,5000,1000];")
    moves = ["    MoveAbsJ jStart\\NoEOffs,feed,fine,tMill;"]
    lines.append(f"  CONST jointtarget jStart:={_joints(first, table)};")
    for i, target in enumerate(targets):
        zone = f"zone{i}" if target.zone else "fine"
        if target.zone:
            z = f"{target.zone:.4f}"
            lines.append(f"  CONST zonedata zone{i}:=[FALSE,{z},{z},{z},1,{z},1];")
        if target.kind == "J":
            lines.append(f"  CONST jointtarget j{i}:={_joints(target.joints, target.table)};")
            moves.append(f"    MoveAbsJ j{i}\\NoEOffs,feed,{zone},tMill;")
            continue
        lines.append(f"  CONST robtarget t{i}:={_target(target.pose, target.table)};")
        if target.kind == "C":
            lines.append(f"  CONST robtarget m{i}:={_target(target.via, target.table)};")
        moves.append(f"    {'MoveC m' + str(i) + ',' if target.kind == 'C' else 'MoveL '}t{i},feed,{zone},tMill;")
    return "\n".join([*lines, "  PROC Run()", "    ConfL\\Off;", *moves, "  ENDPROC", "ENDMODULE", ""])


def _pose(pose: Float) -> str:
    q = Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)
    return f"[[{','.join(f'{x:.6f}' for x in pose[:3, 3])}],[{','.join(f'{x:.10f}' for x in q)}]]"


def _target(pose: Float, table: float) -> str:
    return f"[{_pose(pose)[1:-1]},[0,0,0,0],[{table:.6f},{','.join([UNUSED] * 5)}]]"


def _joints(joints: Float, table: float) -> str:
    return f"[[{','.join(f'{x:.8f}' for x in np.degrees(joints))}],[{table:.6f},{','.join([UNUSED] * 5)}]]"


class Outsider:
    """Drives by Newton on pinocchio's model; asks fcl about its own shapes."""

    def __init__(self, cell: Cell, urdf: Path) -> None:
        self.cell = cell
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.data = self.model.createData()
        self.flange, self.base = (self.model.getFrameId(name) for name in ("tool0", "base_link"))
        self.tip = pin.SE3(cell.flange_from_cutter[:3, :3], cell.flange_from_cutter[:3, 3] / 1e3)
        self.shapes = [(shape, fcl.CollisionObject(_solid(shape))) for shape in cell.shapes]
        self.at_zero = self._links(np.zeros(6))
        self.now = np.zeros(6)

    def _links(self, q: Float) -> list[Float]:
        """Poses of base and six links, mm."""
        pin.forwardKinematics(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        to_base = self.data.oMf[self.base].inverse()
        placed = [to_base * self.data.oMi[i] for i in range(1, 7)]
        return [np.eye(4)] + [_mm(one.homogeneous) for one in placed]

    def tool(self, q: Float) -> pin.SE3:
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.base].inverse() * self.data.oMf[self.flange] * self.tip

    def follow(self, q: Float, pose: Float) -> Float | None:
        """Newton from the posture before; None where it finds no way."""
        wanted = pin.SE3(pose[:3, :3], pose[:3, 3] / 1e3)
        for _ in range(20):
            error = pin.log6(self.tool(q).inverse() * wanted).vector
            if np.abs(error).max() < 1e-9:
                return q
            jacobian = pin.computeFrameJacobian(self.model, self.data, q, self.flange, pin.LOCAL)
            step = np.linalg.lstsq(self.tip.inverse().action @ jacobian, error, rcond=1e-9)[0]
            q = q + np.clip(step, -0.2, 0.2)
        return None

    def unsafe(self, q: Float, table: float) -> str:
        """What is wrong with a posture; '' nothing."""
        low, high = self.model.lowerPositionLimit, self.model.upperPositionLimit
        if ((q < low) | (q > high)).any():
            return "limit"
        now, turned = self._links(q), np.eye(4)
        if self.cell.turntable is not None:
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_euler("z", table, degrees=True).as_matrix()
            turned = self.cell.turntable.base_from_turntable @ turn
            limits = np.degrees(self.cell.turntable.limits)
            if not limits[0] <= table <= limits[1]:
                return "limit"
        for shape, body in self.shapes:
            if shape.link == ON_TURNTABLE:
                at = turned @ shape.pose
            else:
                link = max(shape.link, 0)
                at = now[link] @ np.linalg.inv(self.at_zero[link]) @ shape.pose
            body.setTransform(fcl.Transform(at[:3, :3], at[:3, 3]))
        for i, (a, one) in enumerate(self.shapes):
            for b, other in self.shapes[i + 1 :]:
                if _may_hit(a, b) and fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()):
                    return f"{a.body} hits {b.body}"
        return ""

    def judge(self, first: Float, table: float, targets: list[Target]) -> str:
        """What is wrong with a program; '' nothing."""
        self.now = first
        for place, angle in _places(self, first, table, targets):
            found = place if place.shape == (6,) else self.follow(self.now, place)
            if found is None:
                return "unreachable"
            if np.abs(found - self.now).max() > np.radians(15):
                return "jump"
            self.now = found
            if wrong := self.unsafe(self.now, angle):
                return wrong
        return ""


def _places(outsider: Outsider, first: Float, table: float, targets: list[Target]) -> Iterator[tuple[Float, float]]:
    """Poses (4, 4), or joint angles (6,), and turntable angles in deg, in fine steps."""
    legs: list[Leg] = []
    at, begin = _mm(outsider.tool(first).homogeneous), table
    for target in targets:
        legs.append((at, target, begin))
        at, begin = target.pose, target.table
    cuts = [[0.0, 1.0] for _ in legs]
    for i in range(len(legs) - 1):
        if targets[i].zone > 0 and "J" not in (targets[i].kind, targets[i + 1].kind):
            here, there = _length(legs[i]), _length(legs[i + 1])
            zone = min(targets[i].zone, here / 2, there / 2)
            cuts[i][1], cuts[i + 1][0] = 1 - zone / here, zone / there
    for i, leg in enumerate(legs):
        start, target, angle = leg
        if target.kind == "J":
            q0 = outsider.now
            count = int(np.degrees(np.abs(target.joints - q0).max()) / STEP_DEG) + 2
            for f in np.linspace(0, 1, count):
                yield q0 + f * (target.joints - q0), angle + f * (target.table - angle)
            continue
        turn = (Rotation.from_matrix(start[:3, :3]).inv() * Rotation.from_matrix(target.pose[:3, :3])).magnitude()
        steps = max(_length(leg) / STEP_MM, np.degrees(turn) / STEP_DEG, abs(target.table - angle) / STEP_DEG)
        for f in np.linspace(*cuts[i], int(steps) + 2):
            yield _on(leg, f), angle + f * (target.table - angle)
        if cuts[i][1] < 1:
            after = legs[i + 1]
            a, b = _on(leg, cuts[i][1]), _on(after, cuts[i + 1][0])
            for v in np.linspace(0, 1, int(2 * targets[i].zone / STEP_MM) + 3):
                yield (
                    _corner(a, target.pose, b, v),
                    _bent(
                        angle + cuts[i][1] * (target.table - angle),
                        target.table,
                        target.table + cuts[i + 1][0] * (after[1].table - target.table),
                        v,
                    ),
                )


def _bent(a: float, b: float, c: float, v: float) -> float:
    return (1 - v) ** 2 * a + 2 * v * (1 - v) * b + v * v * c


def _corner(a: Float, corner: Float, b: Float, v: float) -> Float:
    pose = np.eye(4)
    for i in range(3):
        pose[i, 3] = _bent(a[i, 3], corner[i, 3], b[i, 3], v)
    turns = [Rotation.from_matrix(one[:3, :3]) for one in (a, corner, b)]
    one, two = (Slerp([0, 1], Rotation.concatenate(turns[i : i + 2]))(v) for i in (0, 1))
    pose[:3, :3] = Slerp([0, 1], Rotation.concatenate([one, two]))(v).as_matrix()
    return pose


def _on(leg: Leg, f: float) -> Float:
    start, target = leg[:2]
    pose = np.eye(4)
    both = Rotation.from_matrix([start[:3, :3], target.pose[:3, :3]])
    pose[:3, :3] = Slerp([0, 1], both)(min(max(f, 0.0), 1.0)).as_matrix()
    a, b = start[:3, 3], target.pose[:3, 3]
    pose[:3, 3] = a + f * (b - a)
    if target.via is not None:
        centre, axis, sweep = _circle(a, target.via[:3, 3], b)
        pose[:3, 3] = centre + Rotation.from_rotvec(f * sweep * axis).apply(a - centre)
    return pose


def _circle(a: Float, via: Float, b: Float) -> tuple[Float, Float, float]:
    """Three planes meet in the centre."""
    axis = np.cross(via - a, b - a)
    axis /= np.linalg.norm(axis)
    planes = np.array([via - a, b - a, axis])
    centre = np.linalg.solve(planes, [(via - a) @ (via + a) / 2, (b - a) @ (b + a) / 2, axis @ a])
    u, v = a - centre, b - centre
    return centre, axis, float(np.arctan2(np.cross(u, v) @ axis, u @ v) % (2 * np.pi))


def _length(leg: Leg) -> float:
    start, target = leg[:2]
    if target.via is None:
        return float(np.linalg.norm(target.pose[:3, 3] - start[:3, 3]))
    centre, _, sweep = _circle(start[:3, 3], target.via[:3, 3], target.pose[:3, 3])
    return float(np.linalg.norm(start[:3, 3] - centre) * sweep)


def _mm(pose: Float) -> Float:
    made = np.array(pose)
    made[:3, 3] *= 1e3
    return made


def _solid(shape: Shape) -> fcl.CollisionGeometry:
    makers = {"box": fcl.Box, "sphere": fcl.Sphere, "capsule": fcl.Capsule, "cylinder": fcl.Cylinder}
    return makers[shape.kind](*shape.size_mm)


def _may_hit(a: Shape, b: Shape) -> bool:
    moving = [shape for shape in (a, b) if 1 <= shape.link <= 6]
    if not moving or a.body == b.body:
        return False
    return not (0 <= a.link <= 6 and 0 <= b.link <= 6 and abs(a.link - b.link) <= 1)


def with_boxes(cell: Cell, rng: np.random.Generator, targets: list[Target], tip: Float) -> Cell:
    """Boxes near the way: most programs come near one, many run through one."""
    boxes = []
    for i in range(rng.integers(0, 3)):
        near = targets[rng.integers(len(targets))].pose if rng.random() < 0.8 else tip
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
        pose[:3, 3] = near[:3, 3] + rng.normal(size=3) * 150 - near[:3, 2] * rng.uniform(0, 250)
        size = tuple(float(x) for x in np.exp(rng.uniform(np.log(2), np.log(150), 3)))
        boxes.append(Shape(f"box {i}", ON_BASE, "box", size, pose))
    return dataclasses.replace(cell, shapes=(*cell.shapes, *boxes), margin_mm=float(rng.choice([0.0, 2.0, 5.0])))


def study(count: int, seed: int) -> Counter[str]:
    """Judge `count` random programs twice."""
    cell, tally = read_cell(CELL), Counter[str]()
    urdf, judging = CELL.parent / "irb6700_150_320.urdf", 0.0
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        first, table, targets = random_program(cell, rng)
        tip = forward_kinematics(cell.chain, first) @ cell.flange_from_cutter
        here = with_boxes(cell, rng, targets, tip)
        begin = time.process_time()
        found = judge(here, read_rapid(rapid_text(here, first, table, targets), f"{seed}-{number}"))
        judging += time.process_time() - begin
        outsider = Outsider(here, urdf)
        wrong = outsider.judge(first, table, targets)
        tally["programs"] += 1
        tally["passed" if found.passed else "refused"] += 1
        tally["unsafe"] += bool(wrong)
        if found.passed and wrong:
            tally["UNSAFE PASSED"] += 1
            print(f"unsafe passed: seed {seed} number {number}: {wrong}")
        if not found.passed and not wrong:
            tally["refused by a margin or an axis' speed, harmless without"] += 1
        for kind in {violation.kind for violation in found.violations}:
            tally[f"  refused for: {kind}"] += 1
    tally["milliseconds of the judge a program"] = round(1e3 * judging / count)
    return tally


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    begin = time.perf_counter()
    for name, count in sorted(study(options.count, options.seed).items()):
        print(f"{name:60s} {count}")
    print(f"{'seconds':60s} {time.perf_counter() - begin:.0f}")


if __name__ == "__main__":
    main()
