"""Raw edges through the measured loop, and milled blindly beside it, in cells whose errors no plan knows."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.drawn.plates import random_recipe
from bench.drawn.seeds import generator
from bench.harness import ROOT
from bench.metrology.study import NAME, PARTS, REFUSED, Condition, Cover, Row, Study, cover, spread
from bench.score.face import rough_upper_side
from workbench.api import forward_kinematics, jacobian_at, joint_axes
from workbench.artefacts import Engagement, PathCorrection, PathDeflection, Requirements, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment, segment_raw
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


def measure(condition: str, seed: int) -> Row:
    """Take raw edge `seed` of a condition through both loops: truths every 2 mm where the pass cuts."""
    rng = generator(seed, condition)
    drawn = random_recipe(SHAPES[seed % len(SHAPES)], seed)
    hand_eye = drawn.robot.model_copy(update={"hand_eye_error_mm": HAND_EYE_MM / math.sqrt(3.0)})
    cell = CELLS[condition]
    offset = _any_direction(rng, LARGEST_TOOL_ERROR_MM)
    wear = float(rng.uniform(0.0, LARGEST_WEAR_MM)) if cell.wears else 0.0
    drawn_seed = int(rng.integers(2**31))
    turn = _any_direction(rng, LARGEST_TURN_DEG) if cell.turned else np.zeros(3)
    return _both_loops(drawn.model_copy(update={"robot": hand_eye}), cell, Errors(offset, turn, wear, drawn_seed))


def _any_direction(rng: np.random.Generator, most: float) -> Float:
    direction = rng.normal(size=3)
    return np.asarray(rng.uniform(0.0, most) * direction / np.linalg.norm(direction))


def _both_loops(recipe: Recipe, cell: Cell, errors: Errors) -> Row:
    recording, truth = simulate_recording(recipe)
    cloud = denoise(fuse(recording))
    edge = segment_raw(cloud, upper_side=rough_upper_side(truth))
    first = feed(layers(edge, cloud, finish_allowance_mm=ALLOWANCE_MM), cloud, edge)
    blind = layers(edge, cloud)
    gate = check(first, edge, cloud)
    if not gate.passed:
        return {"refused": f"path.check: {gate.reason}"}
    raw = Workpiece(recipe)
    whole = milled_truth(_milled(raw, blind, cell, errors))
    rough = _milled(raw, first, cell, errors)
    again = scan(rough)
    found = sections(segment(denoise(fuse(again)), root_nominal_mm=first.root_mm))
    predicted = _predicted(raw, first, errors.seed) if cell.gives_way else None
    told = LARGEST_WEAR_MM if cell.wears else 0.0
    path, correction = correct(found, first, predicted, repeatability_mm=cell.noise_mm, wear_mm=told)
    finishing = feed(path, cloud, edge)
    gate = check(finishing, edge, cloud, None, correction)
    if correction.refused is not None:
        return {"beyond": correction.refused} | compare(whole, None, correction, first)
    if not gate.passed:
        return {"refused": f"path.check of the finishing pass: {gate.reason}"}
    done = milled_truth(_milled(rough, finishing, cell, errors, finishing=True))
    return compare(whole, done, correction, first)


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


def compare(blind: Truth, done: Truth | None, correction: PathCorrection, first: Toolpath) -> Row:
    """Truth of both parts at places where the pass cuts, beside what the correction says."""
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
    return {name: numbers(column) for name, column in columns.items()}


def numbers(values: Float) -> list[float | None]:
    """As JSON has it: None for what is not finite."""
    return [round(float(v), 6) if np.isfinite(v) else None for v in values]


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


ROOT_P95_MM, LOUD_P95_MM, BEVEL_P95_DEG = 0.05, 0.10, 0.1
LOUD_MM = 0.05  # of noise that does not repeat, from which the wider goal holds
ROOT_MM, BEVEL_DEG = Requirements().root_nominal_mm, Requirements().bevel_nominal_deg
LEAST_MM = ROOT_MM + Requirements().root_tolerance_mm[0]
SINE = math.sin(BEVEL_DEG * DEG)


def off(c: Condition, name: str) -> Float:
    """|error| of all places of the finished parts: median, 95th percentile, worst."""
    errors = np.abs(c.values(name) - (ROOT_MM if name.startswith("root") else BEVEL_DEG))
    known = errors[np.isfinite(errors)]
    return np.asarray(np.percentile(known, (50, 95, 100)) if len(known) else np.full(3, np.nan))


def goal_mm(c: Condition) -> float:
    return LOUD_P95_MM if CELLS[c.name].noise_mm >= LOUD_MM else ROOT_P95_MM


def predicted(c: Condition) -> Cover:
    """Finished root beside what correction and repeatability say, along b, mm."""
    noise = CELLS[c.name].noise_mm
    return cover(
        ((_column(row, "root_mm") - ROOT_MM) * SINE, np.hypot(_column(row, "correction_u_mm"), noise)) for row in c.good
    )


def predicted_turn(c: Condition) -> Cover:
    """Finished bevel angle beside what the correction says, deg."""
    return cover((_column(row, "bevel_deg") - BEVEL_DEG, _column(row, "correction_u_deg")) for row in c.good)


def too_deep(c: Condition) -> list[int]:
    """Seeds of parts below the root's tolerance that a blind run would have left in it."""
    return [row["seed"] for row in c.good if _least(row, "root_mm") < LEAST_MM <= _least(row, "root_blind_mm")]


def blind_too_deep(c: Condition) -> int:
    """Parts below the tolerance when milled blindly."""
    return sum(_least(row, "root_blind_mm") < LEAST_MM for row in (*c.good, *c.having("beyond")))


def _column(row: Row, name: str) -> Float:
    return np.array(row.get(name, []), dtype=float)


def _least(row: Row, name: str) -> float:
    values = _column(row, name)
    return float(np.nanmin(values)) if np.isfinite(values).any() else math.inf


def goals(c: Condition) -> Iterator[tuple[bool, str]]:
    yield not off(c, "root_mm")[1] <= goal_mm(c), "root"
    yield not off(c, "bevel_deg")[1] <= BEVEL_P95_DEG, "bevel"
    yield bool(too_deep(c)), f"{len(too_deep(c))} cut too deep"
    yield predicted(c).surely_not_covered, "finished root within 2u of the correction"
    yield predicted_turn(c).surely_not_covered, "finished bevel within 2u of the correction"


def _covered(found: Cover) -> str:
    bold = "**" * found.surely_not_covered
    return f"{bold}{100 * found.share:.1f}{bold} ({100 * found.low:.1f} to {100 * found.high:.1f})"


def _sizes(found: Cover) -> str:
    return f"{found.bias:+.3f}, {found.rms:.3f}, {found.mean_u:.3f}"


STUDY = Study(
    conditions=tuple(CELLS),
    parts=100,
    page="planning_metrology.md",
    measure=measure,
    goals=goals,
    tables=(
        (
            "Blind and corrected: all places of the finished parts; median, 95th percentile, worst",
            (
                NAME,
                PARTS,
                ("finished", lambda c: len(c.good)),
                ("beyond the allowance", lambda c: len(c.having("beyond"))),
                REFUSED,
                ("blind, abs(root - 1.5), mm", lambda c: spread(off(c, "root_blind_mm"), 3)),
                ("corrected, abs(root - 1.5), mm", lambda c: spread(off(c, "root_mm"), 3)),
                ("goal (95 %)", lambda c: f"{goal_mm(c):g}"),
                ("the robot alone (95 %)", lambda c: f"{1.96 * CELLS[c.name].noise_mm / SINE:.3f}"),
                ("blind, abs(bevel - 40), deg", lambda c: spread(off(c, "bevel_blind_deg"), 3)),
                (f"corrected, abs(bevel - 40), deg (goal {BEVEL_P95_DEG:g})", lambda c: spread(off(c, "bevel_deg"), 3)),
                ("too deep: blind, corrected", lambda c: f"{blind_too_deep(c)}, {len(too_deep(c))}"),
            ),
            None,
        ),
        (
            "Uncertainties of the correction",
            (
                NAME,
                ("finished, along b: within 2u, % (95 % interval)", lambda c: _covered(predicted(c))),
                ("mean and RMS error, mean u, mm", lambda c: _sizes(predicted(c))),
                ("finished, bevel: within 2u, % (95 % interval)", lambda c: _covered(predicted_turn(c))),
                ("mean and RMS error, mean u, deg", lambda c: _sizes(predicted_turn(c))),
            ),
            None,
        ),
    ),
)
