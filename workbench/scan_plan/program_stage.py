"""`scan.program`: a robot program a pass of a planned scan, written and judged as those that mill."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from workbench.artefacts import Chapter, Cutter, Document, Gate, Layer, PathGate, Postures, RobotCell, Toolpath
from workbench.artefacts.decisions import NOT_CHECKED
from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation
from workbench.path import simplify
from workbench.program import write
from workbench.program.words import program_name
from workbench.robot import Cell, forward_kinematics, sliding
from workbench.robot.cell_file import ProcessPart, Signal, SpindlePart
from workbench.robot.collision import outermost
from workbench.robot.makers import MAKERS, Make
from workbench.robot.way import TOO_FAST
from workbench.scan_plan.plan_stage import ScanPass, ScanPlan
from workbench.scan_plan.reach import BODY, Examiner
from workbench.stage import stage
from workbench.units import DEG

TOLERANCE_MM = 0.1  # by which the laser's middle may leave the planned pass
LEVER_MM = 20.0  # of the laser line, at whose ends a turn counts
NO_LOAD = "the load of the scanner: neither mass nor centre of gravity (scan.program: scanner_mass_kg)"
NO_PLAN = "nothing is written: the plan does not reach what is wanted"
Triple = tuple[float, float, float]


@stage("scan.program")
def program(
    plan: ScanPlan,
    cell: RobotCell | None = None,
    *,
    controller: Make | None = None,
    name: Annotated[str, AfterValidator(program_name)] = "ScanEdge",
    trigger_signal: Signal = "doScan",
    ready_signal: Signal | None = "diScanReady",
    scanner_mass_kg: Annotated[float, Field(gt=0, le=100)] | None = None,
    scanner_centre_mm: Triple = (0.0, 0.0, 50.0),
) -> tuple[Document | Chapter | Gate, ...]:
    """Write a program for each pass of a planned scan (docs/scan_planning.md): all of them, or none if one is refused.

    Home, profiler on (`trigger_signal`), the pass, off, home; judged as a milling program (docs/programs.md). The head
    says how to log the poses.

    Args:
        plan: the planned scan.
        cell: the robot cell; without one nothing is written.
        controller: as in `program.write`.
        name: of the programs and their files, followed by the pass.
        trigger_signal: digital output that starts the profiler, by name or number (index from 0).
        ready_signal: digital input (index likewise) that the profiler is recording; null: the program waits.
        scanner_mass_kg: of all that hangs on the flange; null: the cell's tool, else NOT CHECKED.
        scanner_centre_mm: its centre of gravity in the flange.

    Raises:
        InputError: a cell without home (`process`), a signal that the controller cannot name.

    Example:
        >>> from workbench import robot
        >>> from workbench.scan_plan import plan, program
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> given = {"sensor": "data/calibration/sensor.json", "hand_eye": "data/calibration/handeye.json"}
        >>> made = plan(cell, edge="data/synthetic/paths/raw_arc.json", tool_stays=False, **given)
        >>> [one.name for one in program(made[0], cell, scanner_mass_kg=3)[:2]]
        ['ScanEdge1.mod', 'scan_check_1.json']
    """
    if not isinstance(cell, Cell) or plan.scan_cell is None:
        why = f"{NOT_CHECKED}no program: it needs the robot's cell and where the scanner sits on the flange (hand_eye)"
        return (Gate(True, "no program", loosened=() if controller is None else (why,)),)
    if not plan.reached.all():
        return (Gate(False, NO_PLAN),)
    if cell.process is None:
        raise InputError(f"{cell.source}: $.process", "expected where the robot's home is, for a program of a scan")
    maker = MAKERS.get(controller or (cell.controller.dialect if cell.controller else ""))
    logged = maker.logged if maker else "joint angles as driven, flange by the robot's kinematics"
    process = cell.process.model_copy(
        update={
            "spindle": SpindlePart(on_signal=trigger_signal, at_speed_signal=ready_signal, wait_s=5.0),
            "coolant_signal": None,
            "probe": None,
            "restart": False,
            "stop_between_layers": False,
            "feed": None,
        }
    )
    place = _equipped(plan.scan_cell, process, scanner_mass_kg, scanner_centre_mm)
    every = []
    for number, one in enumerate(plan.passes, 1):
        moves, gate = _moves(plan, place, one, number, logged)
        every.append(
            write(
                moves,
                gate,
                place,
                controller=controller,
                name=f"{name}{number}",
                procedure=f"Scan{number}",
                tool_name="tScan",
                work_object_name="woScan",
            )
        )
    gates = [next(one for one in written if isinstance(one, PathGate)) for written in every]
    whole = all(gate.passed for gate in gates)
    out = [
        _of_pass(one, number)
        for number, (written, gate) in enumerate(zip(every, gates, strict=True), 1)
        if whole or not gate.passed  # a scan with a pass left out is no scan
        for one in written
        if isinstance(one, Document | Chapter)
    ]
    return (*out, _joined(gates))


def _of_pass(made: Document | Chapter, number: int) -> Document | Chapter:
    """What is written of a pass, under a name of its own."""
    if isinstance(made, Chapter):
        return dataclasses.replace(made, title=f"Program of pass {number}")
    check = made.name == "program_check.json"
    return dataclasses.replace(made, name=f"scan_check_{number}.json") if check else made


def _joined(gates: list[PathGate]) -> Gate:
    """One decision on all programs."""

    def every(name: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(text for gate in gates for text in getattr(gate, name)))

    reasons = [f"pass {k}: {gate.reason}" for k, gate in enumerate(gates, 1)]
    if any(TOO_FAST in one for one in reasons):
        reasons.append("scan.plan.most_speed_mm_s plans it slower")
    return Gate(all(gate.passed for gate in gates), "; ".join(reasons), every("loosened"), every("unchecked"))


def _equipped(cell: Cell, process: ProcessPart, mass_kg: float | None, centre_mm: Triple) -> Cell:
    """The cell as a scan's program sees it: the scanner is the tool, the nominal plate a body."""
    of_mill = (
        "collision of the cutter",
        "collision with the workpiece",
        "the robot's repeatability",
        "the load of the tool",
        "the cutter's torque and power",
    )
    unchecked = tuple(
        text
        for text in cell.unchecked
        if not text.startswith(of_mill) and not (BODY in text and text.endswith("($.may_touch)"))
    )
    stays = any(shape.body == "cutter" for shape in cell.shapes)
    mass, centre = (cell.tool_mass_kg, cell.tool_centre_of_gravity_mm) if stays else (None, None)
    if mass_kg is not None:
        mass, centre = mass_kg, np.array(centre_mm)
    return dataclasses.replace(
        cell,
        process=process,
        unchecked=unchecked if mass is not None else (*unchecked, NO_LOAD),
        controller_tools={},
        tool_mass_kg=mass,
        tool_centre_of_gravity_mm=centre,
    )


def _moves(plan: ScanPlan, cell: Cell, one: ScanPass, number: int, logged: str):  # type: ignore[no-untyped-def]
    """The pass as moves, with the decision that lets them be written."""
    examiner = Examiner(cell)
    reached = examiner.reach(one.base_from_view, (one.base_from_view,), plan.table)
    count = len(one.base_from_view)
    feed = np.full(count, one.speed_mm_s)
    layer = Layer(
        1,
        0.0,
        one.edge.arc_length_mm,
        one.base_from_view[:, :3, 3],
        quaternion_from_rotation(one.base_from_view[:, :3, :3]),
        feed,
        np.ones(count, bool),
        np.ones(count, bool),
        np.zeros(count),
    )
    about = (
        f"Scanning pass {number} of {len(plan.passes)}, elevation {one.view.elevation / DEG:.0f} deg, stand-off "
        f"{one.view.standoff_mm:.0f} mm",
        f"{one.speed_mm_s:.4g} mm/s: a frame every {one.view.frame_pitch_mm:.4g} mm; U root {plan.wanted.root_mm:g} mm",
        f"log the poses with their times: {logged}",
    )
    path = Toolpath(
        cutter=Cutter(0.0, 1, LEVER_MM),
        layers=(layer,),
        travels=(),
        root_mm=plan.joint.root_mm,
        bevel_deg=plan.joint.bevel / DEG,
        depth_of_cut_mm=0.0,
        v_slow_mm_s=one.speed_mm_s,
        edge_length_mm=plan.edge.length_mm,
        source=plan.edge.source,
        about=about,
    )
    if isinstance(reached, str):
        gate = PathGate(False, reached, toolpath=path, tolerance_mm=TOLERANCE_MM, reached=False)
        return simplify(path), gate
    targets = forward_kinematics(cell.chain, reached.joints) @ cell.flange_from_cutter
    table = outermost(cell, np.full(count, plan.table))
    postures = Postures(
        toolpath=path,
        layer=np.ones(count, np.int64),
        cutting=layer.cutting,
        measured=layer.measured,
        position_mm=targets[:, :3, 3],
        quaternion_wxyz=quaternion_from_rotation(targets[:, :3, :3]),
        feed_mm_s=feed,
        cutter_rotation=np.zeros(count),
        turntable=table,
        joints=reached.joints,
        displacement_mm=np.zeros((count, 3)),
        clearance_mm=examiner.screen.clearances_mm(reached.joints, table),
        flange_from_point=cell.flange_from_cutter,
        has_turntable=cell.turntable is not None,
        on_track=sliding(cell),
    )
    gate = PathGate(True, "the pass is reached", toolpath=path, tolerance_mm=TOLERANCE_MM, reached=True)
    return simplify(path, postures), gate
