"""One raw edge through the measured loop, and milled blindly beside it, in a cell whose errors no plan knows."""

from __future__ import annotations

import functools
import math
import zlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.drawn.plates import random_recipe
from bench.harness import ROOT
from bench.metrology.part import Clock, Numbers, numbers
from bench.metrology.planning.part import rough_upper_side
from workbench.api import forward_kinematics, jacobian_at, joint_axes
from workbench.artefacts import Engagement, PathCorrection, PathDeflection, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment, segment_raw
from workbench.errors import WorkbenchError
from workbench.inspect import sections
from workbench.path import check, correct, feed, layers
from workbench.plugins.stiffness.force import force
from workbench.plugins.stiffness.values import TABLE_2_NM_PER_RAD
from workbench.robot import read_cell
from workbench.scan import fuse
from workbench.synthetic import Recipe, Truth, simulate_recording
from workbench.synthetic.workpiece import Workpiece, milled_truth
from workbench.twin import mill, scan
from workbench.units import DEG, Float


@dataclass(slots=True)
class MeasuredResult:
    """Finished part and blind one by their truth, beside the correction: `places` every 2 mm where the pass cuts."""

    condition: str
    seed: int
    refused: str | None = None  # a stage's error, or a check that refused a path, in one line
    beyond: str | None = None  # `path.correct` refused: more than the allowance allows
    crashed: str | None = None  # any other exception: a defect
    seen_share: float = 1.0  # of the raw edge, by truth
    shape: str = ""
    error_mm: float = 0.0  # of tool and hand-eye together, along the bevel's normal, mean along the edge
    places: dict[str, Numbers] = field(default_factory=dict)  # see `measured.part.compare`
    seconds: dict[str, float] = field(default_factory=dict)


SHAPES = ("raw_straight", "raw_arc", "raw_wavy", "raw_twist")
ALLOWANCE_MM = 0.5
LARGEST_TOOL_ERROR_MM = 0.6
HAND_EYE_MM = 0.4  # root mean square of its length
LARGEST_TURN_DEG = 0.3  # of the tool, about any axis
LARGEST_WEAR_MM = 0.05  # in the first cut
FINISHING_WEAR = 0.5  # of that, in the finishing pass: much for a layer or two of several
BALANCING = 6  # rounds of force and deflection, each halfway to the next: within some micrometres
MODEL_ERROR = 0.15  # relative, of force and stiffness together
STEP_MM = 2.0


@dataclass(frozen=True)
class Cell:
    """What the robot does. `noise_mm`: new in every run; `repeating_mm`: the same at the same place; one axis."""

    noise_mm: float
    repeating_mm: float
    gives_way: bool = False
    wears: bool = False
    turned: bool = False


CELLS = {
    "repeating": Cell(0.003, 0.03),
    "not_repeating": Cell(0.03, 0.0),
    "not_repeating_0.05": Cell(0.05, 0.0),
    "deflection": Cell(0.003, 0.03, gives_way=True),
    "wear": Cell(0.003, 0.03, wears=True),
    "turned": Cell(0.003, 0.03, turned=True),
    "all": Cell(0.02, 0.03, gives_way=True, wears=True, turned=True),
}


@dataclass(frozen=True)
class Errors:
    """What is wrong with the tool of one part, beyond what the robot does."""

    offset_mm: Float  # (3,)
    turn_deg: Float  # (3,) rotation vector
    wear_mm: float
    seed: int  # of the robot's error


def measure_measured(condition: str, seed: int) -> MeasuredResult:
    """Take raw edge `seed` of a condition through both loops. There are no peers."""
    rng = np.random.default_rng([seed, zlib.crc32(condition.encode())])
    shape = SHAPES[seed % len(SHAPES)]
    result = MeasuredResult(condition, seed, shape=shape)
    drawn = random_recipe(shape, seed)
    hand_eye = drawn.robot.model_copy(update={"hand_eye_error_mm": HAND_EYE_MM / math.sqrt(3.0)})
    recipe = drawn.model_copy(update={"robot": hand_eye})
    cell = CELLS[condition]
    offset = _any_direction(rng, LARGEST_TOOL_ERROR_MM)
    wear = float(rng.uniform(0.0, LARGEST_WEAR_MM)) if cell.wears else 0.0
    drawn_seed = int(rng.integers(2**31))
    turn = _any_direction(rng, LARGEST_TURN_DEG) if cell.turned else np.zeros(3)
    try:
        _both_loops(result, recipe, cell, Errors(offset, turn, wear, drawn_seed))
    except WorkbenchError as error:
        result.refused = str(error)
    except Exception as error:
        result.crashed = repr(error)
    return result


def _any_direction(rng: np.random.Generator, most: float) -> Float:
    direction = rng.normal(size=3)
    return np.asarray(rng.uniform(0.0, most) * direction / np.linalg.norm(direction))


def _both_loops(result: MeasuredResult, recipe: Recipe, cell: Cell, errors: Errors) -> None:
    clock = Clock(result.seconds)
    recording, truth = simulate_recording(recipe)
    result.seen_share = float(truth.seen.mean())
    clock.lap("simulation")
    cloud = denoise(fuse(recording))
    edge = segment_raw(cloud, upper_side=rough_upper_side(truth))
    first = feed(layers(edge, cloud, finish_allowance_mm=ALLOWANCE_MM), cloud, edge)
    blind = layers(edge, cloud)
    gate = check(first, edge, cloud)
    clock.lap("planning")
    if not gate.passed:
        result.refused = f"path.check: {gate.reason}"
        return
    raw = Workpiece(recipe)
    whole = milled_truth(_milled(raw, blind, cell, errors))
    rough = _milled(raw, first, cell, errors)
    clock.lap("milling")
    again = scan(rough)
    clock.lap("simulation")
    found = sections(segment(denoise(fuse(again)), root_nominal_mm=first.root_mm))
    predicted = _predicted(raw, first, errors.seed) if cell.gives_way else None
    told = LARGEST_WEAR_MM if cell.wears else 0.0
    path, correction = correct(found, first, predicted, repeatability_mm=cell.noise_mm, wear_mm=told)
    finishing = feed(path, cloud, edge)
    gate = check(finishing, edge, cloud, None, correction)
    clock.lap("correction")
    result.error_mm = float(np.mean(correction.displacement_mm[correction.cut]))
    if correction.refused is not None:
        result.beyond = correction.refused
        compare(result, whole, None, correction, first)
        return
    if not gate.passed:
        result.refused = f"path.check of the finishing pass: {gate.reason}"
        return
    done = _milled(rough, finishing, cell, errors, finishing=True)
    clock.lap("milling")
    compare(result, whole, milled_truth(done), correction, first)


def _milled(part: Workpiece, path: Toolpath, cell: Cell, errors: Errors, *, finishing: bool = False) -> Workpiece:
    """The part milled; where the cell gives way, by the force of what the cutter then meets: in balance."""
    wrong: dict[str, Any] = {
        "offset_mm": tuple(errors.offset_mm.tolist()),
        "rotation_deg": tuple(errors.turn_deg.tolist()),
        "robot_noise_mm": cell.noise_mm,
        "robot_repeating_mm": cell.repeating_mm,
        "wear_mm": (FINISHING_WEAR if finishing else 1.0) * errors.wear_mm,
        "worn_mm": errors.wear_mm if finishing else 0.0,
        "seed": errors.seed,
    }
    done, engagement = mill(part, path, **wrong)
    bending: PathDeflection | None = None
    for _ in range(BALANCING if cell.gives_way else 0):
        now = give_way(path, engagement, errors.seed).by_layer_mm
        if bending is not None:
            now = {index: 0.5 * (moved + bending.by_layer_mm[index]) for index, moved in now.items()}
        bending = PathDeflection(now)
        done, engagement = mill(part, path, bending, **wrong)
    return done


def _predicted(part: Workpiece, path: Toolpath, seed: int) -> PathDeflection:
    """What the cell's model says of giving way: of a perfect cell's forces, and as much in error as such models are."""
    _, engagement = mill(part, path)
    wrong = 1.0 + MODEL_ERROR * np.random.default_rng([seed, 0x5F]).normal()
    found = give_way(path, engagement, seed)
    return PathDeflection({index: wrong * moved for index, moved in found.by_layer_mm.items()})


def compare(
    result: MeasuredResult,
    blind: Truth,
    done: Truth | None,
    correction: PathCorrection,
    first: Toolpath,
) -> None:
    """Truth of both parts at places where the pass cuts."""
    assert first.finishing is not None
    final = first.finishing.layers[-1]
    s = correction.arc_length_mm
    radius = first.cutter.diameter_mm / 2.0
    idle = s[~correction.cut]
    places = np.arange(STEP_MM, correction.length_mm, STEP_MM)
    places = places[np.abs(places[:, None] - idle[None, :]).min(axis=1) > radius]
    at = np.stack([np.interp(places, s, column) for column in final.position_mm.T], axis=1)
    columns = {
        "root_blind_mm": blind.root_mm_at(at),
        "bevel_blind_deg": blind.bevel_deg_at(at),
        "correction_u_mm": np.interp(places, s, correction.displacement_u_mm),
        "correction_u_deg": np.interp(places, s, correction.turn_u) / DEG,
    }
    if done is not None:
        columns |= {"root_mm": done.root_mm_at(at), "bevel_deg": done.bevel_deg_at(at)}
    result.places = _rounded(columns)


def _rounded(columns: dict[str, Float]) -> dict[str, Numbers]:
    return {name: numbers(np.round(column, 6)) for name, column in columns.items()}


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
