"""`scan.plan`: the passes of a scan, chosen for what they will tell."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import (
    Chapter,
    Document,
    Gate,
    HandEye,
    PlannedScan,
    Quantity,
    RobotCell,
    ScanCourse,
    TaughtEdge,
)
from workbench.artefacts.decisions import NOT_CHECKED
from workbench.artefacts.edges import Deviations
from workbench.cad import NominalEdge
from workbench.edge.column_errors import declared_linearity
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.parameters import Direction, RobotNoise
from workbench.errors import InputError
from workbench.geometry.moves import runs
from workbench.geometry.poses import pose_from, quaternion_from_rotation
from workbench.result_files import ScanPlanFile, SensorFile
from workbench.result_files.scan_plan import plan_id
from workbench.robot import Cell, within_margins
from workbench.scan import read_hand_eye
from workbench.scan_plan.edges import modelled, read_edge
from workbench.scan_plan.information import (
    MOST_INCIDENCE,
    RESERVE,
    Joint,
    Knowledge,
    Profiler,
    View,
    edges_of,
    hidden_why,
)
from workbench.scan_plan.reach import Examiner, scan_cell, unknown_side
from workbench.scan_plan.rehearsal import (
    LONGEST_MM,
    WAVE_MM,
    Rehearsed,
    Supposed,
    pooled,
    rehearsed,
    straight,
)
from workbench.scan_plan.search import Candidate, Learned, Reach, Search, Wanted
from workbench.scan_plan.way import EdgeLine, drift_mm, eyes_mm, view_poses
from workbench.stage import InputFile, stage
from workbench.units import COVERAGE, DEG, Bool, Float, Shaped

ELEVATION_STEP = 10.0 * DEG  # at most, between candidates
LEADS_DEG = (0.0, -15.0, 15.0)
PITCHES = (1.0, 0.63, 0.4)  # between frames, of the distance at the greatest speed
LEAST_PITCH_MM = 0.02  # of these: a rehearsal of more frames takes minutes
TABLES_DEG = (0.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0, 120.0, -120.0, 150.0, -150.0, 180.0)
STATION_MM = 10.0  # along the edge, at which reach, rays and U are looked at
OVERRUN_MM = 4.0  # of a pass beyond the edge's ends
REHEARSALS, SUREST = 2, 1e-3  # of other passes each time; the last ones are those that fall least short of so much
PASS_S = 15.0  # from home to a pass, and back
SIDE_KEYS = ("columns", "measuring_range_mm", "width_mm", "noise_mm")
NO_CELL = "reach, collisions and what stands in the way of laser and camera: no cell is named"
NO_BODY = "collision of the scanner: the sensor file gives it no body ($.body)"
NO_CAMERA = "shadows of the camera: the sensor file states no triangulation_deg"
NO_HAND_EYE = "reach and collisions: no hand_eye gives the scanner's pose on the flange"
NO_ROUGHNESS = "roughness of the root face, which is taken for smooth: roughness_mm, or a coarse recording as edge"
MOST_ROUGH_MM = 0.3  # that can be rehearsed
HALF = 0.5
MOST_CAUSES = 4

Positive = Annotated[float, Field(gt=0, le=1e4)]


@dataclass(frozen=True, slots=True, eq=False)
class ScanPass:
    """One pass of a plan, k stations."""

    view: View
    half_turn: bool  # by half a turn about the rays
    edge: EdgeLine  # its stations, those beyond the ends included
    base_from_view: Shaped[Float, "k 4 4"]
    sees: Shaped[Bool, " s"]  # of the plan's stations
    speed_mm_s: float
    drift_mm: float
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class ScanPlan:
    """The passes of a scan, and what they are predicted to tell at s stations along the edge."""

    joint: Joint
    profiler: Profiler
    known: Knowledge
    edge: EdgeLine
    passes: tuple[ScanPass, ...]
    arc_length_mm: Shaped[Float, " s"]
    root: Quantity  # (s,) NaN: no pass sees it
    bevel: Quantity
    promised_root_mm: Shaped[Float, " s"]  # U that nine of ten scans stay within, whatever the rounding
    promised_bevel_deg: Shaped[Float, " s"]
    wanted: Wanted
    binds: tuple[str, ...]
    would_help: tuple[str, ...]
    table: float  # rad
    refused: str | None  # why the engine would refuse the recording
    scan_cell: Cell | None = None  # whose tool is the scanner
    unchecked: tuple[str, ...] = ()

    @property
    def reached(self) -> Shaped[Bool, " s"]:
        """Stations at which what is wanted is promised."""
        kept = (self.promised_root_mm <= self.wanted.root_mm) & (self.promised_bevel_deg <= self.wanted.bevel_deg)
        return kept & (self.refused is None)

    @property
    def turntable_deg(self) -> float | None:
        """At which the passes are driven; None: no turntable, or no cell looked at."""
        axis = getattr(self.scan_cell, "turntable", None)  # there may be no cell
        return None if axis is None or axis.slides else round(self.table / DEG, 6)

    @property
    def seconds(self) -> float:
        """Of all passes."""
        return sum(one.seconds for one in self.passes)


@stage("scan.plan")
def plan(
    cell: RobotCell | None = None,
    taught: TaughtEdge | None = None,
    *,
    edge: InputFile | None = None,
    sensor: InputFile,
    hand_eye: InputFile | None = None,
    upper_side: Direction = (0.0, 0.0, 1.0),
    edge_number: Annotated[int, Field(ge=1)] | None = None,
    base_from_cad: list[list[float]] | None = None,
    thickness_mm: Positive | None = None,
    root_mm: Positive | None = None,
    bevel_deg: Annotated[float, Field(ge=5, le=75)] | None = None,
    raw: bool = False,
    root_tolerance_mm: Deviations = (-0.5, 0.5),
    bevel_tolerance_deg: Deviations = (-1.0, 1.0),
    wanted_root_mm: Positive | None = None,
    wanted_bevel_deg: Positive | None = None,
    passes: Annotated[int, Field(ge=1, le=4)] = 2,
    edge_condition: EdgeCondition = "unknown",
    roughness_mm: Annotated[float, Field(ge=0, le=MOST_ROUGH_MM)] | None = None,
    robot_noise_mm: RobotNoise = 0.07,
    frame_rate_hz: Positive = 200.0,
    most_speed_mm_s: Positive = 100.0,
    tool_stays: bool = True,
    z_away: bool = True,
) -> tuple[ScanPlan | PlannedScan | Document | Chapter | Gate, ...]:
    """Plan the passes of a scan that reach the wanted U.

    The set of least time that reaches it is chosen (docs/scan_planning.md), or the exit status is 1.

    Args:
        cell: the robot cell; without one reach and shadows are not looked at, and the plan says so.
        taught: points along the edge; or:
        edge: roughly where the edge is: a recording, toolpath.json, edge-line.json, CSV (x_mm, y_mm, z_mm) or DXF
            polyline in mm, or STEP model.
        sensor: a sensor.json with columns, measuring_range_mm, width_mm and noise_mm.
        hand_eye: a handeye.json: where the scanner sits on the flange.
        upper_side: rough direction from the lower to the upper side, in the base, where the file has none.
        edge_number: number of the STEP model's edge, as `workbench look` has it; null: there is one.
        base_from_cad: 4x4 (direction cosines, mm), from the STEP model's coordinates to the base; null: the same.
        thickness_mm: of the plate; null: as the STEP model has it, else 8.
        root_mm: of the nominal joint; null: likewise, else 1.5.
        bevel_deg: of the nominal joint; null: likewise, else 40.
        raw: the edge is (also) scanned before it is milled: the end face and a surface of the plate are in view.
        root_tolerance_mm: allowed deviations, which give the default U.
        bevel_tolerance_deg: likewise.
        wanted_root_mm: U (k = 2) of the root face; null: a tenth of the tolerance's width.
        wanted_bevel_deg: of the bevel angle, likewise.
        passes: greatest number of passes.
        edge_condition: as in `edge.segment`.
        roughness_mm: of the sawn or cut root face, three standard deviations; null: as a coarse recording shows it,
            else smooth.
        frame_rate_hz: of the profiler.
        most_speed_mm_s: of the robot along a pass.
        tool_stays: the milling tool stays on the flange; false: it is removed.
        z_away: range increases away from the profiler.

    Raises:
        InputError: no edge, or out of reach; a sensor file that leaves out what is needed; a nominal joint that cannot
            be seen.

    Example:
        >>> from workbench.scan_plan import plan
        >>> path, sensor = "data/synthetic/paths/raw_arc.json", "data/calibration/sensor.json"
        >>> made = plan(edge=path, sensor=sensor, wanted_root_mm=0.02, wanted_bevel_deg=0.1)
        >>> len(made[0].passes), bool(made[0].reached.all())
        (1, True)
    """
    from workbench.scan_plan.chapter import plan_chapter

    model = modelled(edge, edge_number, base_from_cad)
    joint = _joint(model, thickness_mm, root_mm, bevel_deg, raw)
    file = SensorFile.read(sensor)
    profiler = as_profiler(file, sensor)
    eye = None if hand_eye is None else read_hand_eye(hand_eye)
    if model is None:
        line = _roughly(taught, edge, np.array(upper_side), joint, eye)
    else:
        line = EdgeLine.through(model.points_mm, model.upper_side, str(edge))
    turn = 0.0 if eye is None or eye.covariance is None else math.sqrt(float(np.trace(eye.covariance[3:, 3:])) / 3.0)
    rough = line.roughness_mm if roughness_mm is None else roughness_mm
    known = Knowledge(robot_noise_mm, turn, edge_condition, roughness_mm=min(rough or 0.0, MOST_ROUGH_MM))
    wanted = Wanted(
        wanted_root_mm or 0.1 * (root_tolerance_mm[1] - root_tolerance_mm[0]),
        wanted_bevel_deg or 0.1 * (bevel_tolerance_deg[1] - bevel_tolerance_deg[0]),
    )
    if min(wanted) <= 0.0:
        raise InputError("scan.plan", "expected a tolerance of some width, or a wanted U above 0")
    task = Task(joint, profiler, known, line, wanted, passes, frame_rate_hz, most_speed_mm_s)
    if task.pitches_mm[-1] < LEAST_PITCH_MM:
        least, apart = LEAST_PITCH_MM / PITCHES[-1], most_speed_mm_s / frame_rate_hz
        why = f"expected {least:g} mm and more between frames, found {apart:.2g}: too slow a robot?"
        raise InputError("scan.plan.most_speed_mm_s", why)
    place, unchecked = _placed(cell, file, eye, task, tool_stays=tool_stays, z_away=z_away)
    side = unknown_side(cell if isinstance(cell, Cell) else None, line, joint)
    made = planned(task, place, (*unchecked, *side, *((NO_ROUGHNESS,) if rough is None else ())))
    gate = _gate(made)
    document = Document(ScanPlanFile.NAME, written(made, z_away=z_away))
    return made, courses(made, z_away=z_away), document, plan_chapter(made, gate), gate


def _joint(
    model: NominalEdge | None, thickness_mm: float | None, root_mm: float | None, bevel_deg: float | None, raw: bool
) -> Joint:
    """The nominal joint: what is told, else as modelled, else usual sizes."""
    usual = (8.0, 1.5, 40.0)
    if model is not None:
        low, high = np.transpose([model.thickness_mm, model.root_mm, model.bevel_deg])
        usual = tuple((0.5 * (low + high)).tolist())
    given = (thickness_mm, root_mm, bevel_deg)
    thickness, root, bevel = (a if b is None else b for a, b in zip(usual, given, strict=True))
    if root >= thickness:
        raise InputError("scan.plan", f"expected root_mm below thickness_mm, {thickness:g}, found {root:g}")
    return Joint(thickness, root, bevel * DEG, raw)


def _roughly(
    taught: TaughtEdge | None, edge: Path | None, upper_side: Float, joint: Joint, eye: HandEye | None
) -> EdgeLine:
    """Where the edge is."""
    if edge is not None:
        return read_edge(edge, upper_side, joint, eye)
    if taught is None:
        raise InputError("scan.plan", "expected where the edge is: edge=FILE, a recording, a toolpath or points")
    return EdgeLine.through(taught.points_mm, taught.upper_side, taught.source, by_order=True)


class Task(NamedTuple):
    """All that is asked for, but for the robot."""

    joint: Joint
    profiler: Profiler
    known: Knowledge
    edge: EdgeLine
    wanted: Wanted
    passes: int
    frame_rate_hz: float
    most_speed_mm_s: float

    @property
    def pitches_mm(self) -> tuple[float, ...]:
        """Between frames, that are tried."""
        return tuple(share * self.most_speed_mm_s / self.frame_rate_hz for share in PITCHES)

    @property
    def elevations(self) -> tuple[float, ...]:
        """That are tried, rad: where the lower surface is in view too, and from square to the root face upwards.

        Among these square to the bevel face, between both faces' normals, and others at most `ELEVATION_STEP` apart.
        Between the two kinds the lower surface is met at 70 to 90 deg: whether it returns is the sensor's secret.
        """
        beta = self.joint.bevel
        low, high, corner = beta - MOST_INCIDENCE + 1.0 * DEG, MOST_INCIDENCE - 1.0 * DEG, MOST_INCIDENCE - math.pi / 2
        below = low, 0.5 * (low + corner)
        first = max(low, 0.0)
        marks = [first, *(one for one in (0.5 * beta, beta) if first < one < high), high]
        pairs = [*([below] if low < corner else []), *itertools.pairwise(marks)]
        steps = [np.linspace(a, b, math.ceil((b - a) / ELEVATION_STEP), endpoint=False) for a, b in pairs]
        return (*np.concatenate(steps).tolist(), high)

    @property
    def stations(self) -> Float:
        """Arc lengths (s,) mm at which the plan is looked at."""
        return np.linspace(0.0, self.edge.length_mm, max(5, round(self.edge.length_mm / STATION_MM) + 1))

    def drift_mm(self, view: View) -> float:
        """Across the view, along the pass."""
        return drift_mm(self.joint, self.profiler, view, self.edge.length_mm)


def as_profiler(file: SensorFile, path: Path | None) -> Profiler:
    """What the prediction needs of a sensor file.

    Raises:
        InputError: it leaves out what is needed.
    """
    for key in SIDE_KEYS:
        if getattr(file, key) is None:
            raise InputError(f"{path}: $.{key}", "expected a value: a scan cannot be planned without it (data sheet)")
    columns, (near, far), width, noise = (getattr(file, key) for key in SIDE_KEYS)
    if not near < far:
        raise InputError(f"{path}: $.measuring_range_mm", f"expected nearest below farthest, found {near:g}, {far:g}")
    return Profiler(
        columns,
        (near, far),
        width,
        noise,
        max(file.noise_columns or 1.0, 1.0),
        declared_linearity(path),
        (file.triangulation_deg or 0.0) * DEG,
        file.camera_side or "y",
        path,
    )


def _placed(
    cell: RobotCell | None, file: SensorFile, eye: HandEye | None, task: Task, *, tool_stays: bool, z_away: bool
) -> tuple[Cell | None, tuple[str, ...]]:
    """The cell with the scanner in it, and what nothing can look at."""
    camera = () if file.triangulation_deg else (NO_CAMERA,)
    if not isinstance(cell, Cell):
        return None, (NO_CELL, *camera)
    if eye is None:
        return None, (NO_HAND_EYE, *camera)
    place = scan_cell(
        cell,
        file,
        eye.flange_from_profiler,
        task.profiler.middle_mm,
        task.edge,
        task.joint,
        tool_stays=tool_stays,
        z_away=z_away,
    )
    return place, (*(() if file.body else (NO_BODY,)), *camera)


def planned(task: Task, place: Cell | None, unchecked: tuple[str, ...] = ()) -> ScanPlan:
    """The plan: by the turntable angle, of those that are tried in turn, that serves best."""
    views = [View(one, task.profiler.middle_mm, task.pitches_mm[0]) for one in task.elevations]
    if all(hidden_why(task.joint, task.profiler, view) for view in views):
        middle = View(0.5 * task.joint.bevel, task.profiler.middle_mm, task.pitches_mm[0])
        why = hidden_why(task.joint, task.profiler, middle) or "from no elevation are both faces seen"
        raise InputError("scan.plan", f"this joint cannot be measured with this sensor: {why}")
    tables = [0.0]
    if place is not None and place.turntable is not None and not place.turntable.slides:
        low, high = within_margins(place).axes[-1].limits
        tables = [one * DEG for one in TABLES_DEG if low <= one * DEG <= high]
    examiner = None if place is None else Examiner(place)
    learned: list[Learned] = []  # at any angle: what faces and rounding leave open does not turn with the table
    tried: Tried = {}
    offered: dict[frozenset[tuple[View, bytes]], tuple[Reach, _Looked]] = {}
    refused: dict[View, str] = {}
    for table in tables:
        looked = _looked(task, examiner, table)
        refused = refused or looked.refused
        offer = frozenset((one.view, one.sees.tobytes()) for one in looked.candidates)
        if any(offer <= one for one in (frozenset(), *offered)):
            continue  # nothing new
        offered[offer] = _rehearse(task, looked, learned, tried), looked
        promised = any(one.made.reached.all() for one in tried.values())
        if promised or not (looked.refused or looked.by_base):  # else another angle may serve
            break
    if not offered:
        raise InputError(task.edge.source, f"no pass along this edge is possible: {_summary(refused)}")
    if not promised:
        _rehearse(task, min(offered.values(), key=lambda one: one[0])[1], learned, tried, last=True)
    best = min(tried.values(), key=lambda one: _shortfall(one.made))
    made = dataclasses.replace(predicted(task, best.made), scan_cell=place, unchecked=unchecked)
    if made.reached.all():
        return made
    would_help = () if made.refused else tuple(_help(task, best.search, best.chosen))
    return dataclasses.replace(made, binds=tuple(_binds(task, best.looked, made)), would_help=would_help)


def _rehearse(task: Task, looked: _Looked, learned: list[Learned], tried: Tried, *, last: bool = False) -> Reach:
    """Try what the search thinks enough at a turntable angle, at the `last` one whatever it thinks; what is left."""
    search = Search(*task[:3], task.edge.length_mm, task.wanted, looked.candidates, learned)
    for left in reversed(range(REHEARSALS)):
        aim = task.wanted if left or not last else Wanted(*(SUREST * one for one in task.wanted))
        chosen, reach = dataclasses.replace(search, wanted=aim).best(task.passes)
        these = frozenset((one.view, one.sees.tobytes()) for one in (looked.candidates[k] for k in chosen))
        if these in tried or (reach.short and not last):
            break
        made = _made(task, looked, chosen)
        tried[these] = Trial(made, chosen, search, looked)
        if made.reached[search.visible].all():
            break
        _learn(made, search, chosen)
    return reach


def _shortfall(made: ScanPlan) -> tuple[int, int, float]:
    """Stations unseen, those that miss what is wanted, and the largest promised U over it; infinite: it is refused."""
    over = np.fmax(made.promised_root_mm / made.wanted.root_mm, made.promised_bevel_deg / made.wanted.bevel_deg)
    unseen = int(np.isnan(made.promised_root_mm).sum())
    return unseen, int((~made.reached).sum()), float(np.nanmax(over, initial=math.inf if made.refused else 0.0))


def _learn(made: ScanPlan, search: Search, chosen: tuple[int, ...]) -> None:
    """Keep what the rehearsal of these passes promised over what the search thinks of them; refused: never enough."""
    groups, which = search.patterns(chosen)
    for number, group in enumerate(groups):
        here = (which == number) & np.isfinite(made.bevel.u)
        if not group:
            continue
        views = search.views(group)
        if made.refused is not None:
            search.learned.append(Learned(views, math.inf, math.inf))
        elif here.any():
            prediction = search.predicted(group)
            root = float(np.median(made.promised_root_mm[here])) / (RESERVE * COVERAGE * prediction.most_root_mm)
            bevel = float(np.median(made.promised_bevel_deg[here])) / (RESERVE * COVERAGE * prediction.bevel_deg)
            search.learned.append(Learned(views, root, bevel))


class _Looked(NamedTuple):
    """The candidates at one turntable angle."""

    table: float  # rad
    candidates: list[Candidate]
    refused: dict[View, str]  # views that see the joint, and cannot be had
    shadows: list[tuple[View, list[str]]]  # what stands in the way at each station
    on_base: frozenset[str]  # bodies that do not turn with the table

    @property
    def by_base(self) -> bool:
        """Whether one of those throws a shadow."""
        return any(name in self.on_base for _, names in self.shadows for name in names)


class Trial(NamedTuple):
    """Passes that were rehearsed."""

    made: ScanPlan
    chosen: tuple[int, ...]
    search: Search
    looked: _Looked


Tried = dict[frozenset[tuple[View, bytes]], Trial]  # by views, and the stations that each sees


def _looked(task: Task, examiner: Examiner | None, table: float) -> _Looked:
    """Which views the cell allows. Leads only where none without serves."""
    found = _Looked(table, [], {}, [], frozenset() if examiner is None else examiner.on_base)
    at, (n, m) = task.edge.at(task.stations), task.joint.section_mm.T
    corners = at.position_mm[:, None] + n[:, None] * at.normal[:, None] + m[:, None] * at.across[:, None]  # (s, 3, 3)
    for lead in LEADS_DEG:
        for elevation in task.elevations:
            view = View(elevation, task.profiler.middle_mm, task.pitches_mm[0], lead * DEG)
            drift = task.drift_mm(view)
            if hidden_why(task.joint, task.profiler, view):
                continue
            both = tuple(view_poses(at, task.joint, view, half, task.edge.length_mm, drift) for half in (False, True))
            half_turn, sees, fastest = False, np.ones(at.arc_length_mm.size, bool), task.most_speed_mm_s
            if examiner is not None:
                reached = examiner.reach(both[0], (both[0], both[1]), table)
                if isinstance(reached, str):
                    found.refused[view] = reached
                    continue
                half_turn, fastest = reached.half_turn, min(fastest, reached.fastest_mm_s)
                names = examiner.shadows(corners, eyes_mm(task.profiler, view, both[int(half_turn)]), table)
                sees = np.array([not name for name in names])
                found.shadows.append((view, names))
            if not sees.any():
                continue
            for pitch in dict.fromkeys(min(one, fastest / task.frame_rate_hz) for one in task.pitches_mm):
                one = view._replace(frame_pitch_mm=pitch)
                seconds = (task.edge.length_mm + 2.0 * OVERRUN_MM) / (pitch * task.frame_rate_hz) + PASS_S
                found.candidates.append(Candidate(one, half_turn, sees, seconds))
        if found.candidates and np.any([one.sees for one in found.candidates], axis=0).all():
            break
    return found


def _made(task: Task, looked: _Looked, chosen: tuple[int, ...]) -> ScanPlan:
    """The plan of chosen candidates, with what is promised: what they tell of the edge that hides most."""
    quickest_first = sorted(chosen, key=lambda k: looked.candidates[k].seconds)
    passes = tuple(_pass(task, looked, k, (-1.0) ** number) for number, k in enumerate(quickest_first))
    rehearsal = _rehearsal(task, passes, Supposed(edges_of(task.known.edge_condition)[-1], WAVE_MM, 0))
    return ScanPlan(
        *task[:4],
        passes,
        task.stations,
        rehearsal.root,
        rehearsal.bevel,
        RESERVE * COVERAGE * rehearsal.root.u,
        RESERVE * COVERAGE * rehearsal.bevel.u,
        task.wanted,
        (),
        (),
        looked.table,
        rehearsal.refused,
    )


def _rehearsal(task: Task, passes: tuple[ScanPass, ...], supposed: Supposed) -> Rehearsed:
    """Of the passes along the nominal joint, which is straight and a share of the edge long."""
    share = min(1.0, LONGEST_MM / task.edge.length_mm)
    stations = share * task.stations
    line = straight(float(stations[-1]))
    led = []
    for one in passes:
        at = line.at(share * one.edge.arc_length_mm)
        poses = view_poses(at, task.joint, one.view, one.half_turn, line.length_mm, share * one.drift_mm)
        led.append(dataclasses.replace(one, base_from_view=poses))
    sees = np.stack([one.sees for one in passes])
    return rehearsed(*task[:3], _followed(task.profiler, led, True, ""), sees, stations, supposed)


def predicted(task: Task, made: ScanPlan, radii: Sequence[float] = ()) -> ScanPlan:
    """The plan with what is predicted: the root mean square over two radii of the lower edge, each a draw of noise.

    None given: those in the middle of either half of what is held possible.
    """
    one, other = (
        _rehearsal(task, made.passes, Supposed(radius, 0.0, draw))
        for draw, radius in enumerate(radii or edges_of(task.known.edge_condition)[:-1])
    )
    refused = made.refused or one.refused or other.refused
    return dataclasses.replace(
        made, root=pooled(one.root, other.root), bevel=pooled(one.bevel, other.bevel), refused=refused
    )


def _pass(task: Task, looked: _Looked, k: int, side: float) -> ScanPass:
    candidate = looked.candidates[k]
    view, sees, speed = candidate.view, candidate.sees, candidate.view.frame_pitch_mm * task.frame_rate_hz
    seen = task.stations[sees]
    ends = max(seen[0] - STATION_MM, 0.0) - OVERRUN_MM, min(seen[-1] + STATION_MM, task.edge.length_mm) + OVERRUN_MM
    at = task.edge.at(np.linspace(*ends, max(3, round(ends[1] - ends[0]) + 1)))
    drift = side * task.drift_mm(view)
    poses = view_poses(at, task.joint, view, candidate.half_turn, task.edge.length_mm, drift)
    return ScanPass(view, candidate.half_turn, at, poses, sees, speed, drift, candidate.seconds)


def _binds(task: Task, looked: _Looked, made: ScanPlan) -> Iterator[str]:
    """What keeps the plan from what is wanted, and where."""
    stations, root, bevel = task.stations, made.root, made.bevel
    if made.refused is not None:
        yield f"the engine refuses such a recording: {made.refused}"
        return
    unseen = np.isnan(root.u)
    for first, last in runs(unseen):
        names = Counter(name for _, row in looked.shadows for name in row[first : last + 1] if name)
        by = " and ".join(name for name, _ in names.most_common(2)) or "no pass that the robot can drive"
        yield f"shadow of {by} from {stations[first]:.0f} to {stations[last]:.0f} mm: no pass sees the edge there"
    for quantity, promised, most in (
        (root, made.promised_root_mm, task.wanted.root_mm),
        (bevel, made.promised_bevel_deg, task.wanted.bevel_deg),
    ):
        short = ~unseen & (promised > most)
        if short.any():
            worst = int(np.nanargmax(np.where(short, promised, np.nan)))
            source = max(quantity.u_by_source, key=lambda name: quantity.u_by_source[name][worst])
            first, last = np.flatnonzero(short)[[0, -1]]
            predicted_u = f"{COVERAGE * quantity.u[worst]:.3g} {quantity.unit}"
            yield (
                f"U of {quantity.name} is predicted as {predicted_u}, by what noise and edge leave open up to "
                f"{promised[worst]:.3g}, wanted {most:.3g}, from {stations[first]:.0f} to {stations[last]:.0f} mm: "
                f"most of it by the {source}"
            )
    if looked.refused:
        yield f"the robot cannot take {_summary(looked.refused)}"


def _summary(refused: dict[View, str]) -> str:
    """Refused views in words, by cause."""
    causes: dict[str, list[float]] = {}
    for view, why in refused.items():
        causes.setdefault(why, []).append(view.elevation / DEG)
    if not causes:
        return "something stands in the way of laser or camera everywhere"
    ranked = sorted(causes.items(), key=lambda one: -len(one[1]))[:MOST_CAUSES]
    return "; ".join(f"elevations of {min(e):.0f} to {max(e):.0f} deg: {why}" for why, e in ranked)


def _help(task: Task, search: Search, chosen: tuple[int, ...]) -> Iterator[str]:
    """What would bring the plan to what is wanted, or a good way nearer: each thing tried by itself."""
    now = search.reach(chosen)
    more = task.passes + 1
    found = search.best(more)[1]
    if found < now and found.excess < 0.9 * now.excess:
        yield _better(f"{more} passes", now.excess, found.excess)
    profiler, known, anew = task.profiler, task.known, {"learned": list[Learned]()}
    exact = profiler.linearity._replace(rms_mm=0.0)
    # What the rehearsal found more than the search lies in the rounding or in the waves: with others it is open again.
    changes: dict[str, dict[str, Any]] = {
        "a sensor of half the noise": {"profiler": dataclasses.replace(profiler, noise_mm=HALF * profiler.noise_mm)},
        "a sensor of twice as many columns": {"profiler": dataclasses.replace(profiler, columns=2 * profiler.columns)},
        "a sensor without error of linearity": {"profiler": dataclasses.replace(profiler, linearity=exact)},
        "a robot without position noise": {"known": known._replace(robot_noise_mm=0.0)},
        "a hand-eye pose without error of rotation": {"known": known._replace(hand_eye_turn=0.0)},
        "knowing that the edge is sharp (edge_condition)": {"known": known._replace(edge_condition="sharp"), **anew},
        f"a smooth root face, not {known.roughness_mm:.2g} mm rough": {
            "known": known._replace(roughness_mm=0.0),
            **anew,
        },
    }
    for what, change in changes.items():
        other = dataclasses.replace(search, **change)
        after = other.reach(chosen).excess
        if (other.known, other.profiler) != (known, profiler) and after < 0.9 * now.excess:
            yield _better(what, now.excess, after)


def _better(what: str, before: float, after: float) -> str:
    return (
        f"{what}: U from {before:.2f} times what is wanted to {'within it' if after <= 1.0 else f'{after:.2f} times'}"
    )


def _gate(made: ScanPlan) -> Gate:
    """Passed where every station reaches what is wanted."""
    share = float(made.reached.mean())
    count = f"{len(made.passes)} pass" + ("es" if len(made.passes) > 1 else "")
    reason = f"{count} in {made.seconds:.0f} s: U {made.wanted.root_mm:g} mm and "
    reason += f"{made.wanted.bevel_deg:g} deg reached at {100 * share:.0f} % of the edge"
    loosened = tuple(f"{NOT_CHECKED}{text}" for text in made.unchecked if made.scan_cell is None)
    kept = () if made.scan_cell is None else made.unchecked
    if made.reached.all():
        return Gate(True, reason, (), (*kept, *(text.removeprefix(NOT_CHECKED) for text in loosened)))
    return Gate(False, "; ".join([reason, *made.binds]), (), kept)


def written(made: ScanPlan, *, z_away: bool = True) -> bytes:
    """`scan-plan.json`."""

    def column(values: Float) -> list[float | None]:
        return [None if not math.isfinite(v) else round(float(v), 6) for v in values]

    return ScanPlanFile.written(
        {
            "frame": "base",
            "edge": made.edge.source,
            "thickness_mm": made.joint.thickness_mm,
            "root_mm": made.joint.root_mm,
            "bevel_deg": round(made.joint.bevel / DEG, 9),
            "edge_condition": made.known.edge_condition,
            "wanted_root_U_mm": made.wanted.root_mm,
            "wanted_bevel_U_deg": made.wanted.bevel_deg,
            "reached": bool(made.reached.all()),
            "duration_s": round(made.seconds, 3),
            "columns": made.profiler.columns,
            "passes": [_pass_row(made, k, one, z_away) for k, one in enumerate(made.passes, 1)],
            "predicted": {
                "arc_length_mm": column(made.arc_length_mm),
                "root_U_mm": column(COVERAGE * made.root.u),
                "bevel_U_deg": column(COVERAGE * made.bevel.u),
                "promised_root_U_mm": column(made.promised_root_mm),
                "promised_bevel_U_deg": column(made.promised_bevel_deg),
                "reached": made.reached.tolist(),
                "root_u_by_source_mm": {name: column(u) for name, u in made.root.u_by_source.items()},
                "bevel_u_by_source_deg": {name: column(u) for name, u in made.bevel.u_by_source.items()},
            },
            "binds": list(made.binds),
            "would_help": list(made.would_help),
            "not_checked": list(made.unchecked),
        }
    )


def courses(made: ScanPlan, *, z_away: bool = True) -> PlannedScan:
    """The plan as a scanner follows it."""
    return _followed(made.profiler, made.passes, z_away, plan_id(written(made, z_away=z_away)))


def _followed(profiler: Profiler, passes: Sequence[ScanPass], z_away: bool, name: str) -> PlannedScan:
    standoff = profiler.middle_mm
    known = profiler.triangulation > 0.0 and profiler.camera_side.endswith("y")
    side = -1.0 if profiler.camera_side.startswith("-") else 1.0
    return PlannedScan(
        tuple(ScanCourse(_profiler_poses(one, z_away), one.view.frame_pitch_mm) for one in passes),
        profiler.columns,
        profiler.pitch_mm(standoff),
        standoff,
        profiler.range_mm,
        profiler.noise_mm,
        side * standoff * math.tan(profiler.triangulation) if known else None,
        z_away,
        name,
    )


def _profiler_poses(one: ScanPass, z_away: bool) -> Shaped[Float, "k 4 4"]:
    """base_from_profiler: its origin where ranges count from."""
    sense = 1.0 if z_away else -1.0
    origin = one.base_from_view[:, :3, 3] - one.view.standoff_mm * one.base_from_view[:, :3, 2]
    return pose_from(one.base_from_view[:, :3, :3] * [1.0, sense, sense], origin)


def _pass_row(made: ScanPlan, index: int, one: ScanPass, z_away: bool) -> dict[str, object]:
    poses = _profiler_poses(one, z_away)
    points = [
        {
            "arc_length_mm": round(float(s), 6),
            "position_mm": np.round(p, 6).tolist(),
            "quaternion_wxyz": np.round(q, 9).tolist(),
            "feed_mm_s": one.speed_mm_s,
            "cutting": False,
            "measured": True,
        }
        for s, p, q in zip(
            one.edge.arc_length_mm, poses[:, :3, 3], quaternion_from_rotation(poses[:, :3, :3]), strict=True
        )
    ]
    return {
        "index": index,
        "elevation_deg": round(one.view.elevation / DEG, 6),
        "lead_deg": round(one.view.lead / DEG, 6),
        "standoff_mm": one.view.standoff_mm,
        "speed_mm_s": one.speed_mm_s,
        "frame_pitch_mm": one.view.frame_pitch_mm,
        "drift_mm": round(one.drift_mm, 6),
        "turntable_deg": made.turntable_deg,
        "duration_s": round(one.seconds, 3),
        "points": points,
    }
