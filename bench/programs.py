"""Random programs: what the judge lets pass, driven by an outsider in fine steps. `python -m bench.programs --help`.

Each program is RAPID text: straight, circular and joint moves, rounded corners, a turntable, one that tilts besides
(--positioner), or a track under the robot (--track), in a cell with random boxes near the way. The judge sees the text.
The outsider (`bench.program_outsider`) sees the numbers that the text was made from. Unsafe: a contact, a joint or an
external axis beyond its limit, a joint that jumps. Promises:
the clearance and the distance from limits that the judge states for a program that passed; bodies of which a cell tells
that they are not checked are left out, and such programs counted. The goal is none unsafe
among those that passed, and no promise broken.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from bench.harness import ROOT, Option, Study
from bench.program_outsider import Outsider, Target
from bench.tables import markdown
from workbench.artefacts import Judgement
from workbench.program.rapid import MODES, MODULE, Module
from workbench.robot import Cell, forward_kinematics, read_cell
from workbench.robot.cell_model import ON_BASE, ON_CRADLE, ON_TURNTABLE, Shape, Turntable
from workbench.robot.collision import left_out
from workbench.robot.judge import judge
from workbench.units import Float

CELL = ROOT / "data" / "robot" / "cell.json"
TOGETHER = 250  # programs that the outsider drives side by side
ALL_DRIVEN = 500  # of the first so many those that are refused, too
UNUSED = "9E9"


def random_program(cell: Cell, rng: np.random.Generator) -> tuple[Float, Float | float, list[Target]]:
    """First joint angles (6,) rad, first external angles in deg (of a track, mm), and targets, on its floor."""
    track = cell.turntable is not None and cell.turntable.slides
    goes = -cell.turntable.base_from_turntable[:3, 2] if track else np.zeros(3)  # the base, a millimetre
    low, high = cell.chain.limits.T
    while True:
        q = np.radians([*rng.uniform([-60, -20, -40], [60, 50, 40]), *rng.uniform([-150, -110, -150], [150, 110, 150])])
        tip = forward_kinematics(cell.chain, q) @ cell.flange_from_cutter
        if abs(q[4]) > np.radians(8) and tip[2, 3] > 250 and ((q > low) & (q < high)).all():
            break
    tilts = len(cell.axes) > 1
    start, table = q, rng.uniform([-45, -90], [45, 90]) if tilts else float(rng.uniform(-90, 90))
    if track:
        tip[:3, 3] += table * goes
    at = tip
    first_table, targets = table, list[Target]()
    heading = rng.normal(size=3)
    for _ in range(rng.integers(2, 5)):
        heading = heading / np.linalg.norm(heading) + 0.8 * rng.normal(size=3)
        pose = at.copy()
        pose[:3, 3] += heading / np.linalg.norm(heading) * rng.uniform(5, 100)
        pose[:3, :3] = at[:3, :3] @ Rotation.from_rotvec(np.radians(rng.normal(size=3) * 10)).as_matrix()
        after_joints = not targets or targets[-1].kind == "J"
        kind, via, joints = rng.choice(["L", "J"] if after_joints else ["L", "L", "L", "C", "J"]), None, None
        if kind == "C":
            via = pose.copy()
            chord = pose[:3, 3] - at[:3, 3]
            across = np.cross(chord, rng.normal(size=3))
            bulge = rng.uniform(0.1, 0.4) * np.linalg.norm(chord) / np.linalg.norm(across)
            via[:3, 3] = at[:3, 3] + chord / 2 + bulge * across
        step = rng.choice([0.0, rng.normal() * (60 if track else 8)])
        table = table + (rng.normal(size=2) * 8 * rng.integers(0, 2, 2) if tilts else float(step))
        if kind == "J":
            joints = start + np.radians(rng.normal(size=6) * 8)
            pose = forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter
            if track:
                pose[:3, 3] += table * goes
            targets[-1:] = [dataclasses.replace(one, zone=0.0) for one in targets[-1:]]
        zone = 0.0 if kind == "J" else float(rng.choice([0.0, 0.3, rng.uniform(1, 20)]))
        targets.append(Target(str(kind), pose, via, joints, table, zone))
        at = pose
    targets[-1].zone = 0.0
    return start, first_table, targets


def rapid_text(cell: Cell, first: Float, table: Float | float, targets: list[Target]) -> str:
    """The program as a file."""
    lines = [
        "MODULE Random",
        f"  PERS tooldata tMill:=[TRUE,{_pose(cell.flange_from_cutter)},[15,[0,0,150],[1,0,0,0],0,0,0]];",
    ]
    lines += ["  CONST speeddata feed:=[20,50,5000,1000];", f"  CONST jointtarget jStart:={_joints(first, table)};"]
    moves = ["    MoveAbsJ jStart\\NoEOffs,feed,fine,tMill\\WObj:=wobj0;"]
    for i, target in enumerate(targets):
        zone = f"zone{i}" if target.zone else "fine"
        if target.zone:
            z = f"{target.zone:.4f}"
            lines.append(f"  CONST zonedata zone{i}:=[FALSE,{z},{z},{z},1,{z},1];")
        if target.joints is not None:
            lines.append(f"  CONST jointtarget j{i}:={_joints(target.joints, target.table)};")
            moves.append(f"    MoveAbsJ j{i}\\NoEOffs,feed,{zone},tMill\\WObj:=wobj0;")
            continue
        lines.append(f"  CONST robtarget t{i}:={_target(target.pose, target.table)};")
        over = ""
        if target.via is not None:
            lines.append(f"  CONST robtarget m{i}:={_target(target.via, target.table)};")
            over = f"m{i},"
        moves.append(f"    {'MoveC' if over else 'MoveL'} {over}t{i},feed,{zone},tMill\\WObj:=wobj0;")
    return "\n".join([*lines, "  PROC Run()", *MODES, *moves, MODULE.say("end"), ""])


def _pose(pose: Float) -> str:
    q = Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True)
    return f"[[{','.join(f'{x:.6f}' for x in pose[:3, 3])}],[{','.join(f'{x:.10f}' for x in q)}]]"


def _target(pose: Float, table: Float | float) -> str:
    return f"[{_pose(pose)[1:-1]},[0,0,0,0],{_external(table)}]"


def _joints(joints: Float, table: Float | float) -> str:
    return f"[[{','.join(f'{x:.8f}' for x in np.degrees(joints))}],{_external(table)}]"


def _external(table: Float | float) -> str:
    said = [f"{x:.6f}" for x in np.atleast_1d(table)]
    return f"[{','.join([*said, *[UNUSED] * (6 - len(said))])}]"


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
    links = [ON_BASE] * len(boxes)
    if len(cell.axes) > 1:  # half of them on table or cradle
        links = [int(link) for link in rng.choice([ON_BASE, ON_BASE, ON_TURNTABLE, ON_CRADLE], len(boxes))]
    if cell.turntable is not None and not cell.turntable.slides and rng.random() < 0.5:
        beam, post = _beam_and_post(cell, rng, targets[0].table)
        boxes += [beam, post]
        links += [ON_TURNTABLE, int(rng.choice([ON_BASE, ON_CRADLE])) if len(cell.axes) > 1 else ON_BASE]
    frames = dict(zip([ON_TURNTABLE, ON_CRADLE], [axis.base_from_turntable for axis in cell.axes[::-1]], strict=False))
    boxes = [
        dataclasses.replace(one, link=link, pose=np.linalg.inv(frames.get(link, np.eye(4))) @ one.pose)
        for one, link in zip(boxes, links, strict=True)
    ]
    if cell.turntable is not None and cell.turntable.slides:  # on the floor, or along with the robot
        floor = np.linalg.inv(cell.turntable.base_from_turntable)
        boxes = [dataclasses.replace(one, link=ON_TURNTABLE, pose=floor @ one.pose) for one in boxes]
    made = dataclasses.replace(cell, shapes=(*cell.shapes, *boxes), margin_mm=float(rng.choice([0.0, 2.0, 5.0])))
    return dataclasses.replace(made, unchecked=(*made.unchecked, *left_out(made, ())))


def _beam_and_post(cell: Cell, rng: np.random.Generator, table: Float | float) -> tuple[Shape, Shape]:
    """A beam of the turntable's own, with all axes at 0, and a post beside it where the table stands at first, deg."""
    assert cell.turntable is not None
    low = cell.turntable.base_from_turntable.copy()
    low[:3, 3] -= 130 * low[:3, 2]
    angle = np.radians(np.atleast_1d(table)[-1] + rng.normal() * 25)
    stands = low.copy()
    stands[:3, 3] += rng.uniform(500, 700) * (low[:3, :2] @ [np.cos(angle), np.sin(angle)])
    return (
        Shape("turntable", ON_TURNTABLE, "box", (1300.0, 150.0, 60.0), low),
        Shape("post", ON_BASE, "box", (60.0, 60.0, 400.0), stands),
    )


def on_a_track(cell: Cell, rng: np.random.Generator) -> Cell:
    """The cell with a track in any direction instead of its turntable, whose floor takes the turntable's bodies."""
    assert cell.turntable is not None
    frame = np.eye(4)
    frame[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    to_floor = np.linalg.inv(frame) @ cell.turntable.base_from_turntable
    shapes = [
        dataclasses.replace(one, pose=to_floor @ one.pose) if one.link == ON_TURNTABLE else one
        for one in cell.shapes
        if one is not _foot(cell)
    ]
    track = Turntable(frame, np.radians([-400.0, 400.0]), np.radians(1500.0), slides=True)
    return dataclasses.replace(cell, turntable=track, shapes=tuple(shapes))


def on_a_tilt(cell: Cell, rng: np.random.Generator) -> Cell:
    """The cell with its turntable on an axis in any direction, near it, that carries a beam instead of a foot."""
    assert cell.turntable is not None
    frame = np.eye(4)
    frame[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    frame[:3, 3] = cell.turntable.base_from_turntable[:3, 3] + rng.uniform([-200, -200, -300], [200, 200, 100])
    tilt = Turntable(frame, np.radians([-60.0, 60.0]), np.radians(20.0), tilts=True)
    beam = Shape("tilt", ON_CRADLE, "box", (120.0, 120.0, 500.0), np.eye(4))
    shapes = (*(one for one in cell.shapes if one is not _foot(cell)), beam)
    return dataclasses.replace(cell, turntable=dataclasses.replace(cell.turntable, on=tilt), shapes=shapes)


def _foot(cell: Cell) -> Shape:
    """Of the turntable, on the floor."""
    return next(one for one in cell.shapes if one.link == ON_TURNTABLE and one.size_mm == (200, 400))


def judged(found: Judgement) -> Counter[str]:
    """What is counted of the judge's verdict on a program."""
    kinds = {violation.kind for violation in found.violations}
    return Counter(["programs", "passed" if found.passed else "refused", *(f"refused for: {kind}" for kind in kinds)])


def summed(tallies: Sequence[Mapping[str, int]], _: Namespace) -> Iterator[str]:
    """All blocks together."""
    tally = Counter[str]()
    for one in tallies:  # zeros are told, too
        tally.update(one)
    yield from markdown(["", "count"], ([name, f"{count}"] for name, count in sorted(tally.items())))


def driven(task: tuple[str, int, int, int]) -> Counter[str]:
    """Judge a block of random programs; the outsider drives those that passed, and all of the first ones."""
    kind, seed, first_number, last = task
    cell = dataclasses.replace(read_cell(CELL), process=None)  # random programs begin anywhere
    if kind != "turntable":
        cell = {"track": on_a_track, "positioner": on_a_tilt}[kind](cell, np.random.default_rng([seed]))
    tally, judging, some = Counter[str](), 0.0, []
    outsider = Outsider(CELL.parent / "irb6700_150_320.urdf", cell)
    for number in range(first_number, last):
        rng = np.random.default_rng([seed, number])
        first, table, targets = random_program(cell, rng)
        tip = forward_kinematics(cell.chain, first) @ cell.flange_from_cutter
        here = with_boxes(cell, rng, targets, tip)
        start = time.process_time()
        found = judge(here, Module().program({"random.mod": rapid_text(here, first, table, targets)}))
        judging += time.process_time() - start
        tally.update(judged(found))
        if found.passed or number < ALL_DRIVEN:
            some.append((number, found, here, first, table, targets))
    ways = outsider.drive([row[3:] for row in some])
    for (number, found, here, *_), (wrong, joints, tables) in zip(some, ways, strict=True):
        broken = wrong
        if found.passed and not wrong:
            broken = outsider.broken(here, joints, tables, found.clearance_mm, found.limit_margin)
        if broken or not found.passed:
            wrong = wrong or outsider.unsafe(here, joints, tables)
        tally["driven by the outsider"] += 1
        tally["of these unsafe"] += bool(wrong)
        if not found.passed:
            tally["of these refused for a margin or an axis' speed, harmless without"] += not wrong
            continue
        tally["of the passed, told that two bodies are not checked"] += len(here.unchecked) > len(cell.unchecked)
        tally["UNSAFE PASSED"] += bool(wrong)
        tally["PROMISES BROKEN"] += bool(broken)
        tally["places of the outsider"] += len(joints)
        if broken:
            print(f"seed {seed} number {number}: {broken}", file=sys.stderr)
    tally["seconds of the judge"] = round(judging)
    return tally


def tasks(given: Namespace) -> Iterator[tuple[str, int, int, int]]:
    kind = "track" if given.track else "positioner" if given.positioner else "turntable"
    for low in range(0, given.count, TOGETHER):
        yield kind, given.seed, low, min(low + TOGETHER, given.count)


STUDY = Study(
    "programs",
    str(__doc__),
    {
        "track": Option(False, "the robot stands on a track, and the turntable does not turn"),
        "positioner": Option(False, "the turntable stands on an axis that tilts it"),
        "count": Option(40),
        "seed": Option(1),
    },
    tasks,
    driven,
    summed,
)
if __name__ == "__main__":
    STUDY()
