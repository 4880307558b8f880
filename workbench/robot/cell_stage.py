"""`robot.cell`: the robot cell from its file."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from workbench.errors import InputError, nearest
from workbench.geometry.poses import frame_about, inverse, pose_from, unit
from workbench.parameters import parsed
from workbench.robot.cell_file import (
    AxisPart,
    CellPart,
    EnvelopePart,
    RobotPart,
    ShapePart,
    TrackPart,
    TurntablePart,
    UncertaintyPart,
    WorkObjectPart,
    WorkpiecePart,
    stated,
)
from workbench.robot.cell_model import (
    ON_BASE,
    ON_CRADLE,
    ON_TURNTABLE,
    Cell,
    Margins,
    Shape,
    Turntable,
    read_mesh,
    spindle_warning,
)
from workbench.robot.collision import CUTS, CollisionModel, left_out
from workbench.robot.judge import JudgedCell
from workbench.robot.kinematics import Chain
from workbench.robot.plate_stage import check_size, read_workpiece, scanned
from workbench.robot.plausible import bare_mm, check_plausible, external_axes
from workbench.robot.process import NO_PROCESS
from workbench.robot.urdf import disabled_pairs, read_urdf, track_joint
from workbench.robot.wrist import offset_wrist, spherical_wrist
from workbench.stage import InputFile, stage
from workbench.strict_json import read_json
from workbench.units import DEG, Float

NO_WORKPIECE = "collision with the workpiece: the cell file gives none, and no scan was handed over (robot.plate)"
HARMLESS = ("Adjacent", "Never")  # an SRDF's reasons by which nothing is left out that could happen
LEFT_OPEN = {  # by what the file does not state, or states as 0: what nothing can look at then
    "work_object": "the work object: the cell file states none ($.work_object); targets are in the robot's base",
    "workpiece.mesh": NO_WORKPIECE,
    "robot.repeatability_mm": "the robot's repeatability against the root face: the cell file states none "
    "($.robot.repeatability_mm)",
    "tool.spindle": "the cutter's torque and power against the spindle's: the cell file states none ($.tool.spindle)",
    "envelope": "the robot's envelope: the cell file states none ($.envelope)",
    "margin_mm": "a clearance between bodies: the cell file asks for none ($.margin_mm is 0)",
    "uncertainty": "robustness against the uncertainty of tool, base and turntable: none is stated ($.uncertainty)",
    "process": f"{NO_PROCESS} ($.process)",
    "robot.acceleration_deg_s2": "accelerations of the joints: the cell file states none ($.robot.acceleration_deg_s2)",
    "turntable.acceleration_deg_s2": "acceleration of the turntable: the cell file states none "
    "($.turntable.acceleration_deg_s2)",
    "turntable.tilt.acceleration_deg_s2": "acceleration of the tilt: the cell file states none "
    "($.turntable.tilt.acceleration_deg_s2)",
    "track.acceleration_mm_s2": "acceleration of the track: the cell file states none ($.track.acceleration_mm_s2)",
}
OWN = ("tool", "cutter", "workpiece", "turntable", "tilt", "envelope")  # bodies that `may_touch` means by these names
TAKEN = "another body of the cell has it, and $.may_touch would mean both"
WALL_MM = 2000.0  # thickness of the envelope's walls: what is beyond is within them


@stage("robot.cell")
def cell(
    *,
    cell: InputFile | None,
) -> Cell | None:
    """Read the robot cell: URDF, tool, turntable, workpiece, fixtures, set-up of loading tests.

    Args:
        cell: a cell file (JSON); null: none, and no program.

    Raises:
        InputError: the file or one that it names is missing or unusable, an unknown frame.

    Example:
        >>> from workbench import robot
        >>> robot.cell(cell="data/robot/cell.json").chain.limits.shape
        (6, 2)
    """
    return None if cell is None else read_cell(cell)


def read_cell(path: Path) -> Cell:
    """The cell that a file describes; raises InputError with the file and the place in it."""
    part, before = _with_track(parsed(CellPart, read_json(path), f"{path}: $"), path)
    robot = part.robot
    held = robot.held if part.track is None or part.track.joint is None else robot.held | {part.track.joint: 0.0}
    found = _packages(robot, path), robot.arguments
    chain, links = read_urdf(path.parent / robot.urdf, robot.base_frame, robot.flange_frame, held, *found)
    external = _external(part, path)
    rails = [(one, base.body) for one in sorted(before) for base in links if base.link == 0 and base.body not in before]
    links = tuple(_on_floor(shape, external) if shape.body in before else shape for shape in links)
    cutter = part.tool.flange_from_cutter
    tool = [
        _shape(shape, shape.body, 6, chain.base_from_flange_at_zero, f"{path}: $.tool.shapes[{i}]", path)
        for i, shape in enumerate(part.tool.shapes)
    ]
    shapes = (*links, *tool, *_around(part, external, path))
    _check_names(part, {shape.body for shape in links}, path)
    known = {shape.body for shape in shapes} | {"tool", "cutter", "workpiece"}  # a scan may become the workpiece
    for name in (name for pair in part.may_touch for name in pair):
        if name not in known:
            raise InputError(f"{path}: $.may_touch", f"unknown body '{name}'{nearest(name, known)}")
    srdf = {} if robot.srdf is None else disabled_pairs(path.parent / robot.srdf)
    disabled = {pair: why for pair, why in srdf.items() if known.issuperset(pair)}
    check_plausible(part, f"{path}: $")
    warnings = (spindle_warning(cutter), _inverse_warning(chain))
    tools, frames = _on_controller(part)
    made = JudgedCell(
        source=str(path),
        title=part.title or chain.name,
        chain=chain,
        shapes=shapes,
        flange_from_cutter=cutter,
        turntable=external,
        loading=part.loading,
        may_touch=(*part.may_touch, *disabled, *rails),
        unseen=tuple(
            f"collision of {one} and {other}: the SRDF lets them touch ({why})"
            for (one, other), why in disabled.items()
            if why not in HARMLESS
        ),
        margin_mm=part.margin_mm,
        warnings=tuple(filter(None, warnings)),
        margins=_margins(part),
        accelerations=_array(part.robot.acceleration_deg_s2, DEG),
        controller_tools=tools,
        controller_frames=frames,
        unchecked=tuple(_not_said(part, shapes)),
        process=part.process,
        configuration=tuple(part.robot.configuration),
        tool_mass_kg=part.tool.mass_kg,
        tool_centre_of_gravity_mm=_array(part.tool.centre_of_gravity_mm),
        base_from_workobject=(part.work_object or WorkObjectPart()).pose,
        repeatability_mm=part.robot.repeatability_mm,
        spindle=part.tool.spindle,
        material=part.workpiece.material,
        joint_stiffness_nm_per_rad=_array(part.robot.joint_stiffness_nm_per_rad),
        controller=part.controller,
    )
    _check_turntable(made, path)
    return dataclasses.replace(made, unchecked=(*made.unchecked, *_odd(part, made), *left_out(made, part.may_touch)))


def _odd(part: CellPart, cell: Cell) -> Iterator[str]:
    """Frames that a cell may have, but hardly ever has."""
    table, why = cell.turntable, "is it upside down, or does the robot hang, its $.robot.base_frame not the world?"
    if table is not None and not table.slides and table.base_from_turntable[2, 2] < -0.5:
        yield f"which way the turntable turns: its z points down in $.turntable.base_from_turntable: {why}"
    if part.work_object is not None and part.envelope is not None:
        frame, room = cell.base_from_workobject, part.envelope
        off = [((room.lowest_mm > at) | (at > room.highest_mm)).any() for at in (frame[:3, 3], inverse(frame)[:3, 3])]
        if off == [True, False]:
            yield "the work object's place: outside $.envelope, and inside by the inverse of $.work_object.pose"


def _check_names(part: CellPart, links: set[str], path: Path) -> None:
    """Refuse two bodies of one name: what `may_touch` allows one of them, it would allow the other unseen."""
    for name in sorted(links & CUTS):
        raise InputError(f"{path}: $.robot.urdf", f"expected another name of the link '{name}': {TAKEN}")
    taken = links | set(OWN)
    for i, fixture in enumerate(part.fixtures):
        if fixture.name in taken:
            raise InputError(f"{path}: $.fixtures[{i}].name", f"expected another name than '{fixture.name}': {TAKEN}")
        taken.add(fixture.name)


def _check_turntable(cell: Cell, path: Path) -> None:
    """Refuse a turntable or its tilt that stands within the robot's base, where `may_touch` does not let it."""
    own = {axis.name: f"base_from_{axis.name}" for axis in cell.axes if not axis.slides}
    bodies = [shape for shape in cell.shapes if shape.link >= ON_TURNTABLE and shape.body in own]
    base = [dataclasses.replace(shape, link=6) for shape in cell.shapes if shape.link == 0]  # so that they count
    touch = (*cell.may_touch, ("turntable", "tilt"))
    alone = dataclasses.replace(cell, shapes=(*base, *bodies), may_touch=touch, margin_mm=0.0, margins=Margins())
    if touching := CollisionModel(alone).collision(np.zeros(6)) if bodies else None:
        where = f"tilt.{own['tilt']}" if touching[1] == "tilt" else own["turntable"]
        raise InputError(
            f"{path}: $.turntable.{where}",
            f"expected the {touching[1]} beside the robot, found it in its {touching[0]}: is it in another unit or "
            "frame, or may they touch ($.may_touch)?",
        )


def _packages(robot: RobotPart, path: Path) -> dict[str, Path]:
    return {name: path.parent / folder for name, folder in robot.packages.items()}


def _margins(part: CellPart) -> Margins:
    """Margins, and the uncertainties of tool and part as the robot sees them."""
    said = part.uncertainty or UncertaintyPart()
    return Margins(
        limit=part.margins.limit_deg * DEG,
        wrist=part.margins.wrist_deg * DEG,
        condition=part.margins.condition,
        flange_mm=said.tool_u_mm,
        flange_rad=said.tool_u_deg * DEG,
        part_mm=float(np.hypot(said.base_u_mm, said.turntable_u_mm)),
        part_rad=float(np.hypot(said.base_u_deg, said.turntable_u_deg)) * DEG,
    )


def _array(values: tuple[float, ...] | None, unit: float = 1.0) -> Float | None:
    return None if values is None else np.array(values) * unit


def _on_controller(part: CellPart) -> tuple[dict[str, Float], dict[str, Float]]:
    """Tools (by the cutter's tip) and frames that the controller has under a name."""
    tool, place = part.tool.controller_name, part.work_object
    tools = {} if tool is None else {tool: part.tool.flange_from_cutter}
    if place is None or place.controller_name is None:
        return tools, {}
    return tools, {place.controller_name: place.pose}


def _not_said(part: CellPart, shapes: tuple[Shape, ...]) -> Iterator[str]:
    """What the cell file leaves open: a program says so, since nothing could look at it."""
    yield from _bodies_not_said(part, shapes)
    if part.tool.controller_name is None and None in (part.tool.mass_kg, part.tool.centre_of_gravity_mm):
        yield "the load of the tool: neither its name on the controller nor mass and centre of gravity ($.tool)"
    for place, sentence in LEFT_OPEN.items():
        above = place.rpartition(".")[0]
        if stated(part, place) in (None, 0) and (not above or stated(part, above) is not None):
            yield sentence


def _bodies_not_said(part: CellPart, shapes: tuple[Shape, ...]) -> Iterator[str]:
    """Bodies without a shape, and joints that must stand."""
    bare = [str(link) for link in range(1, 6) if not any(shape.link == link for shape in shapes)]
    if bare:
        yield f"collision of the robot's links {', '.join(bare)}: the URDF gives them no <collision>"
    if part.robot.held:
        stands = ", ".join(f"{name} at {value:g}" for name, value in part.robot.held.items())
        yield f"that these joints stand where the cell file has them, and nothing moves them: {stands}"
    if not part.tool.shapes:
        yield "collision of the tool: the cell file gives it no shapes ($.tool.shapes)"
    elif short := bare_mm(part.tool):
        yield f"collision of the cutter: the tool's shapes end {short:.0f} mm from its tip ($.tool.shapes)"


def _walls(part: EnvelopePart) -> Iterator[Shape]:
    """Six boxes around the envelope."""
    low, high = np.array(part.lowest_mm), np.array(part.highest_mm)
    for axis in range(3):
        for side in (-1.0, 1.0):
            size = high - low + 2 * WALL_MM
            size[axis] = WALL_MM
            pose = np.eye(4)
            pose[:3, 3] = (low + high) / 2
            pose[axis, 3] = (high[axis] + WALL_MM / 2) if side > 0 else (low[axis] - WALL_MM / 2)
            yield Shape("envelope", ON_BASE, "box", tuple(size.tolist()), pose)


def _inverse_warning(chain: Chain) -> str | None:
    """A robot without an inverse has its stiffness all the same; what needs the inverse refuses it then."""
    try:
        spherical_wrist(chain)
    except InputError as error:
        return f"no inverse kinematics: {error}" if offset_wrist(chain) is None else None
    return None


def _stands(external: Turntable | None) -> dict[str, tuple[int, Float]]:
    """Link and place of what a fixture may stand on; the base is a track's floor."""
    here = np.eye(4)
    if external is None:
        return {"base": (ON_BASE, here)}
    if not external.slides:
        tilt = {} if external.on is None else {"tilt": (ON_CRADLE, here)}
        return {"base": (ON_BASE, here), "turntable": (ON_TURNTABLE, here), **tilt}
    return {"base": (ON_TURNTABLE, inverse(external.base_from_turntable)), "carriage": (ON_BASE, here)}


def _around(part: CellPart, external: Turntable | None, path: Path) -> list[Shape]:
    """Turntable, workpiece and fixtures."""
    stands, found = _stands(external), []
    for place, axis, _ in external_axes(part):
        name = place.rpartition(".")[2]
        found += [
            _shape(shape, name, *stands[name], f"{path}: $.{place}.shapes[{i}]", path)
            for i, shape in enumerate(axis.shapes)
        ]
    on_floor = stands["base"]
    if part.envelope is not None:
        found += [
            dataclasses.replace(wall, link=on_floor[0], pose=on_floor[1] @ wall.pose) for wall in _walls(part.envelope)
        ]
    if part.workpiece.mesh is not None:
        found += _workpiece(part.workpiece, *stands.get("turntable", on_floor), path)
    for i, fixture in enumerate(part.fixtures):
        where = f"{path}: $.fixtures[{i}]"
        if fixture.on not in stands:
            missing = "track" if fixture.on == "carriage" else fixture.on
            raise InputError(f"{where}.on", f"expected 'base': the cell has no {missing}")
        found.append(_shape(fixture, fixture.name, *stands[fixture.on], where, path))
    return found


def _workpiece(part: WorkpiecePart, link: int, parent: Float, path: Path) -> list[Shape]:
    assert part.mesh is not None
    where, pose = f"{path}: $.workpiece.mesh", parent @ part.pose
    points, triangles = read_workpiece(path.parent / part.mesh, where)
    if len(triangles):
        return [Shape("workpiece", link, "mesh", (), pose, points, triangles)]
    return scanned(points, part.voxel_mm, link, pose, where)


def _shape(part: ShapePart, body: str, link: int, parent: Float, where: str, path: Path) -> Shape:
    pose = parent @ part.pose
    if part.mesh is not None:
        vertices, triangles = read_mesh(path.parent / part.mesh, f"{where}.mesh")
        check_size(vertices, path.parent / part.mesh, f"{where}.mesh")
        return Shape(body, link, "mesh", (), pose, vertices, triangles)
    assert part.solid is not None
    return Shape(body, link, *part.solid, pose)


def _with_track(part: CellPart, path: Path) -> tuple[CellPart, frozenset[str]]:
    """The cell with what the URDF states of the track, and the names of the links that do not go along."""
    track, robot = part.track, part.robot
    if track is None or track.joint is None:
        return part, frozenset()
    if track.joint in robot.held:
        raise InputError(f"{path}: $.track.joint", f"expected a joint that moves, '{track.joint}' is in $.robot.held")
    direction, limits, speed, before = track_joint(
        path.parent / robot.urdf, track.joint, robot.base_frame, _packages(robot, path), robot.arguments
    )
    declared = {"direction": tuple(direction), "limits_mm": tuple(limits), "speed_mm_s": speed}
    open_ = {name: value for name, value in declared.items() if getattr(track, name) is None}
    return part.model_copy(update={"track": track.model_copy(update=open_)}), before


def _on_floor(shape: Shape, external: Turntable | None) -> Shape:
    """A body, placed in the base, that stays where a track leaves it."""
    assert external is not None
    return dataclasses.replace(shape, link=ON_TURNTABLE, pose=inverse(external.base_from_turntable) @ shape.pose)


def _external(part: CellPart, path: Path) -> Turntable | None:
    """The turntable, or the track's floor as the robot sees it: it slides against the track's direction."""
    home = None if part.process is None else part.process.home
    if home is not None and home.tilt_deg is not None and (part.turntable is None or part.turntable.tilt is None):
        raise InputError(f"{path}: $.process.home.tilt_deg", "expected null, the cell's turntable has no tilt")
    if part.track is None:
        return None if part.turntable is None else _turntable(part.turntable)
    if part.turntable is not None:
        raise InputError(
            f"{path}: $.track",
            "expected a turntable or a track, found both: one external axis is planned; let the track stand "
            "($.robot.held), or the table (a fixture)",
        )
    if home is not None and home.turntable_deg is not None:
        raise InputError(f"{path}: $.process.home.turntable_deg", "expected track_mm, the cell has a track")
    return _track(part.track)


def _track(track: TrackPart) -> Turntable:
    assert track.direction is not None  # or its joint has told them
    assert track.speed_mm_s is not None
    floor = pose_from(frame_about(-unit(np.array(track.direction))).T, np.zeros(3))
    assert track.limits_mm is not None
    fastest = None if track.acceleration_mm_s2 is None else track.acceleration_mm_s2 * DEG
    return Turntable(floor, np.array(track.limits_mm) * DEG, track.speed_mm_s * DEG, fastest, slides=True)


def _turntable(part: TurntablePart) -> Turntable:
    if part.tilt is None:
        return _axis(part.base_from_turntable, part)
    tilt = dataclasses.replace(_axis(part.tilt.base_from_tilt, part.tilt), tilts=True)
    return dataclasses.replace(_axis(part.base_from_turntable, part), on=tilt)


def _axis(pose: Float, part: AxisPart) -> Turntable:
    fastest = None if part.acceleration_deg_s2 is None else part.acceleration_deg_s2 * DEG
    return Turntable(pose, np.array(part.limits_deg) * DEG, part.speed_deg_s * DEG, fastest)
