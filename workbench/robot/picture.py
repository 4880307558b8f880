"""A picture of the cell in a posture: four views by VTK, in a process of its own."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from workbench.errors import InputError, OutputError
from workbench.offscreen import cause_of, problem_of, start_drawing
from workbench.robot.cell import Cell
from workbench.robot.collision import CollisionModel, turntable_pose
from workbench.robot.description import nearest_gaps, posture_text
from workbench.robot.kinematics import forward_kinematics
from workbench.robot.shapes import ON_BASE
from workbench.robot.triangles import cell_triangles
from workbench.units import AnyArray, Float, Shaped

SIDES = 64  # of a round body
ROBOT, HIT = ("#e8a33d", "#d9922b"), "#d11f1f"  # one link and the next
COLOURS = {"tool": "#4f5d75", "cutter": "#2f3a4f", "turntable": "#8d99a6", "workpiece": "#b59b6a"}
RED = "; red: in collision"
AROUND = ("#a9bcae", "#b7aec4", "#c4b5a5", "#a5b8c4")


@dataclass(frozen=True, slots=True, eq=False)
class CellPicture:
    """What is drawn, in mm in the base. F frames, B bodies."""

    triangles_mm: Shaped[Float, "t 3 3"]
    body: Shaped[AnyArray, " t"]  # index of the body of each triangle
    names: tuple[str, ...]  # (B,)
    colours: tuple[str, ...]  # (B,) '#rrggbb'
    named: Shaped[AnyArray, " B"]  # bool: its name is written beside it
    base_from_frame: Shaped[Float, "F 4 4"]
    frames: tuple[str, ...]  # (F,)
    gaps_mm: Shaped[Float, "g 2 3"]  # the nearest points of bodies
    caption: str


def cell_picture(cell: Cell, joints: Float, turntable: float) -> bytes:
    """A PNG of the cell at joint angles (6,) and a turntable angle, rad.

    Robot, tool, turntable, workpiece and fixtures as their collision shapes, colliding ones in red; frames; and the
    shortest distance.

    Raises:
        OutputError: VTK cannot draw here; the line names the missing system libraries.
    """
    view = _view(cell, joints, turntable)
    with tempfile.TemporaryDirectory(prefix="workbench-cell-") as folder:
        np.savez(Path(folder) / "cell.npz", **{f.name: getattr(view, f.name) for f in fields(view)})
        try:
            problem = problem_of(start_drawing("workbench.robot.draw", ["cell"], folder))
        except OSError as error:
            problem = str(error)
        drawn = Path(folder) / "cell.png"
        if problem or not drawn.is_file():
            raise OutputError("picture of the cell", f"VTK could not draw offscreen ({cause_of(problem)})")
        return drawn.read_bytes()


def _view(cell: Cell, joints: Float, turntable: float) -> CellPicture:
    """Bodies, frames and the gap between the nearest two."""
    gaps = CollisionModel(cell).gaps(joints, turntable)
    hit = {name for gap in gaps if gap.near for name in gap.pair}
    shown = [gap.points_mm for gap in nearest_gaps(cell, gaps) if gap.points_mm is not None and gap.distance_mm > 0]
    made = cell_triangles(cell, joints, turntable, SIDES)
    if not made:
        raise InputError(cell.source, "expected bodies to draw: neither the URDF nor the cell file gives any")
    names = tuple(dict.fromkeys(name for name, _ in made))
    frames = _frames(cell, joints, turntable)
    posture = posture_text(joints, turntable) + (RED if hit else "")
    return CellPicture(
        triangles_mm=np.concatenate([triangles for _, triangles in made]),
        body=np.concatenate([np.full(len(triangles), names.index(name)) for name, triangles in made]),
        names=names,
        colours=_colours(cell, names, hit),
        named=np.array([any(s.body == name and s.link == ON_BASE for s in cell.shapes) for name in names]),
        base_from_frame=np.array(list(frames.values())),
        frames=tuple(frames),
        gaps_mm=np.array(shown).reshape(-1, 2, 3),
        caption=f"{cell.title}\n{posture}",
    )


def _colours(cell: Cell, names: tuple[str, ...], hit: set[str]) -> tuple[str, ...]:
    links = {shape.body: ROBOT[shape.link % 2] for shape in cell.shapes if 0 <= shape.link <= 6}
    others = [name for name in names if name not in links and name not in COLOURS]
    own = {**links, **COLOURS, **{name: AROUND[i % len(AROUND)] for i, name in enumerate(others)}}
    return tuple(HIT if name in hit else own[name] for name in names)


def _frames(cell: Cell, joints: Float, turntable: float) -> dict[str, Float]:
    """`base_from_frame` by name."""
    flange = forward_kinematics(cell.chain, joints)
    found = {"base": np.eye(4), "flange": flange, "cutter": flange @ cell.flange_from_cutter}
    if cell.loading is not None:
        found["sensor"] = flange @ cell.loading.flange_from_sensor
    if cell.turntable is not None:
        found["turntable"] = turntable_pose(cell, turntable)
    return found
