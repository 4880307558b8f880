"""One simulated calibration against its truth; other methods on its circles; planned postures beside random ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.drawn.spheres import random_sphere_recipe
from bench.metrology.calibration.truth import Cell, bound, cell_of, circles
from bench.metrology.part import Clock
from bench.peers.genetic import genetic_hand_eye
from workbench.errors import WorkbenchError
from workbench.geometry.poses import pose_from, rotation_from_rpy, rotation_from_vector
from workbench.plugins.calibration import circles as find_circles
from workbench.plugins.calibration import hand_eye, methods
from workbench.plugins.calibration.model import Estimate, Noise, information, linearise, signed_centres
from workbench.plugins.calibration.observations import Observations, by_pass, from_arrays
from workbench.plugins.calibration.plan import (
    Limits,
    Optics,
    candidate_postures,
    chosen_postures,
    information_gains,
    poses,
)
from workbench.plugins.calibration.shared_errors import correlated
from workbench.plugins.calibration.solve import Answer, solve
from workbench.synthetic import SphereRecipe, simulate_sphere
from workbench.synthetic.sphere import design_hand_eye, in_profiler, sphere_motion
from workbench.synthetic.workpiece import pose as placed
from workbench.units import DEG, Float


@dataclass(slots=True)
class CalibrationResult:
    """Errors over the field of view ("vol", RMS of a point), their bounds, and what the calibration said of itself."""

    condition: str
    seed: int
    refused: str | None = None  # the stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    vol_mm: float | None = None  # error
    bound_mm: float | None = None  # Cramer-Rao bound, at the truth
    u_mm: float | None = None  # as the calibration predicts it
    nees: float | None = None  # squared error of the six unknowns in units of the stated covariance: chi-square, 6
    rotation_deg: float | None = None  # error
    offset_ms: float | None = None  # error of the clock's offset
    offset_bound_ms: float | None = None
    offset_covered: bool | None = None  # within 1.96 times its stated uncertainty
    signs_wrong: int = 0  # postures put on the wrong side of the laser plane
    wrong: bool = False  # the error is beyond all uncertainty, whatever is said
    warned: bool = False
    flagged: bool = False  # a misfit that repeatability cannot explain
    gross_found: bool | None = None  # all postures that are grossly off were rejected
    sound_rejected: int = 0  # postures that are not
    correlated_nees: float | None = None  # with robot_error 'correlated'
    correlated_vol_mm: float | None = None
    random_mm: float | None = None  # median bound of random postures within a plan's limits
    others: dict[str, float] = field(default_factory=dict)  # method -> vol error
    seconds: dict[str, float] = field(default_factory=dict)


SCANS = ("sphere_scans", "sphere_weaved", "sphere_scans_common", "sphere_weaved_common")
PROFILES = ("sphere_stray", *SCANS, "scans_alike")  # these are measured from the points on
UNKNOWN_RADIUS_MM = 5.0
UNKNOWN_MM, UNKNOWN_RAD, UNKNOWN_CENTER_MM = 50.0, 20 * DEG, 100.0  # before any posture
RADIUS_U_MM = 0.05
CLEAR_MM = 0.5  # six sigma of a recorded pose: a centre nearer to the laser plane has no side
WITHIN = 1.96  # standard uncertainties: 95 % of a normal error
WRONG = 10.0  # standard deviations over the field of view


def measure_calibration(condition: str, seed: int) -> CalibrationResult:
    """Simulate recording `seed` of a condition, calibrate and compare with its truth. There are no peers to ask for."""
    result = CalibrationResult(condition, seed)
    try:
        if condition == "sphere_planned":
            measure_plan(result, random_sphere_recipe("sphere_nine", seed))
        elif condition in PROFILES:
            _from_points(result, random_sphere_recipe(condition, seed))
        else:
            _from_circles(result, random_sphere_recipe(condition, seed))
    except WorkbenchError as error:
        result.refused = str(error)
    except Exception as error:
        result.crashed = repr(error)
    return result


def recorded(recipe: SphereRecipe) -> Float:
    """Flange poses (k, 4, 4) as recorded, of postures held still."""
    from workbench.geometry.poses import rotation_from_quaternion

    return np.array(
        [pose_from(rotation_from_quaternion(m.quaternion_wxyz[0]), m.position_mm[0]) for m in sphere_motion(recipe)]
    )


def _from_circles(result: CalibrationResult, recipe: SphereRecipe) -> None:
    """Circles with the noise that their points' noise makes: fast, and the fit of circles is not what is asked."""
    cell = cell_of(recipe)
    circle, covariance = circles(cell, np.random.default_rng([recipe.seed, 9]))
    seen = from_arrays(circle, covariance, recorded(recipe))
    noise = Noise(radius_mm=recipe.sphere.diameter_mm / 2, radius_u_mm=RADIUS_U_MM)
    clock = Clock(result.seconds)
    answer = solve(seen, noise, design_hand_eye(recipe))
    clock.lap("solve")
    kept = np.array([not any(one.gross_mm) for one in recipe.passes])
    sound = Cell(
        cell.hand_eye,
        cell.turned[kept],
        cell.centre[kept],
        cell.radius_mm,
        cell.noise_mm,
        cell.pitch_mm,
        cell.pose_mm,
        cell.pose_deg,
    )
    result.bound_mm = sound.vol_u_mm(bound(sound, covariance[kept], RADIUS_U_MM))
    _compare(result, cell, answer, seen, kept)
    if result.condition in ("sphere_systematic", "sphere_smooth"):
        other, _ = correlated(answer.found, answer.seen, noise)
        pose = pose_from(other.estimate.rotation, other.estimate.translation_mm)
        result.correlated_nees = _nees(cell, pose, other.covariance[:6, :6])
        result.correlated_vol_mm = cell.vol_mm(pose)
    if result.condition == "sphere_grid":
        compare_methods(result, cell, answer, design_hand_eye(recipe))


def _compare(result: CalibrationResult, cell: Cell, answer: Answer, seen: Observations, kept: Any) -> None:
    """Error, uncertainty, signs and what was said."""
    estimate, covariance = answer.found.estimate, answer.found.covariance[:6, :6]
    pose = pose_from(estimate.rotation, estimate.translation_mm)
    _errors(result, cell, pose, covariance)
    y = linearise(estimate, seen, answer.found.noise).centre[:, 1]
    clear = kept & (np.abs(cell.centre[:, 1]) > CLEAR_MM)
    result.signs_wrong = int((np.sign(y) != np.sign(cell.centre[:, 1]))[clear].sum())
    if not kept.all():
        result.gross_found = not answer.found.used[~kept].any()
    result.sound_rejected = int((~answer.found.used[kept]).sum())
    result.flagged = answer.found.misfit
    result.warned = result.flagged or not answer.alone or not answer.found.used.all()


def _errors(result: CalibrationResult, cell: Cell, pose: Float, covariance: Float) -> None:
    result.vol_mm, result.u_mm = cell.vol_mm(pose), cell.vol_u_mm(covariance)
    result.nees = _nees(cell, pose, covariance)
    result.rotation_deg = float(np.degrees(np.linalg.norm(cell.off(pose)[3:])))
    result.wrong = result.vol_mm > WRONG * result.u_mm


def _nees(cell: Cell, pose: Float, covariance: Float) -> float:
    off = cell.off(pose)
    return float(off @ np.linalg.solve(covariance, off))


def _from_points(result: CalibrationResult, recipe: SphereRecipe) -> None:
    """From simulated profiles, as a user would: circles, then the hand-eye pose."""
    recording, truth = simulate_sphere(recipe)
    free = UNKNOWN_RADIUS_MM if result.condition == "sphere_stray" else RADIUS_U_MM
    clock = Clock(result.seconds)
    profiles = find_circles(recording)
    clock.lap("circles")
    _, found, _ = hand_eye(profiles, recording, sphere_radius_u_mm=free)
    clock.lap("solve")
    cell = cell_of(recipe, truth)
    pose = found.hand_eye.flange_from_profiler
    result.warned, result.flagged = bool(found.warnings), any("misfit" in words for words in found.warnings)
    seen_frames = np.array([frames[0] for frames in found.frames])
    y, true_y = found.centre_mm[:, 1], truth.centre_mm[seen_frames, 1]
    clear = np.abs(true_y) > CLEAR_MM
    result.signs_wrong = int((np.sign(y) != np.sign(true_y))[clear & found.used].sum())
    here = Cell(
        cell.hand_eye,
        cell.turned[seen_frames],
        cell.centre[seen_frames],
        cell.radius_mm,
        cell.noise_mm,
        cell.pitch_mm,
        cell.pose_mm,
        cell.pose_deg,
    )
    _errors(result, here, pose, found.covariance)
    if result.condition == "sphere_stray":
        covariance = circles(here, np.random.default_rng(0))[1]
        result.bound_mm = here.vol_u_mm(bound(here, covariance, free))
        return
    robot = recipe.robot
    assert found.time_offset_s is not None
    assert found.time_offset_u_s is not None
    result.offset_ms = 1e3 * (found.time_offset_s - robot.clock_offset_s)
    result.offset_covered = abs(result.offset_ms) < WITHIN * 1e3 * found.time_offset_u_s
    at_truth = Estimate(
        cell.hand_eye[:3, :3],
        cell.hand_eye[:3, 3],
        np.array(recipe.sphere.center_mm),
        cell.radius_mm,
        robot.clock_offset_s,
    )
    seen = by_pass(profiles, recording).place(robot.clock_offset_s)
    noise = Noise(cell.pose_mm, cell.pose_deg, cell.radius_mm, RADIUS_U_MM, robot.pose_noise_common)
    least = np.linalg.inv(information(at_truth, seen, noise, with_offset=True))
    result.offset_bound_ms = 1e3 * float(np.sqrt(least[10, 10]))
    result.bound_mm = here.vol_u_mm(least[:6, :6])


POSTURES, RANDOM_SETS, CANDIDATES = 9, 40, 800
REACH = 0.95  # of |y| in radii, beyond which the circle is too small
ROUGH_MM, ROUGH_DEG = 0.2, 0.1  # what the hand-eye pose is off, each axis, when the plan is made


def compare_methods(result: CalibrationResult, cell: Cell, answer: Answer, design: Float) -> None:
    """Every method on the centres, signs and postures that the bundle has found."""
    fit = answer.found
    seen = answer.seen.subset(fit.used)
    P = signed_centres(fit.estimate, linearise(fit.estimate, seen, fit.noise), seen)
    centres = methods.Centres(P, seen.base_from_flange[:, :3, :3], seen.base_from_flange[:, :3, 3])
    start = pose_from(fit.estimate.rotation, fit.estimate.translation_mm)
    ways = {
        "analytic": lambda: methods.analytic(centres),
        "GA": lambda: genetic_hand_eye(design, centres, np.random.default_rng(result.seed)),
        "differential evolution": lambda: methods.genetic(design, centres, result.seed),
        "joint": lambda: methods.joint(start, centres),
        "bundle": lambda: start,
    }
    for name, way in ways.items():
        result.others[name] = cell.vol_mm(way())


def measure_plan(result: CalibrationResult, recipe: SphereRecipe) -> None:
    """Nine planned postures beside the median of random nines within the same limits, by bound; and calibrated."""
    rng = np.random.default_rng([recipe.seed, 11])
    cell, scanner = cell_of(recipe), recipe.scanner
    true = placed(recipe.robot.flange_from_profiler)
    center = np.array(recipe.sphere.center_mm)
    truth = Estimate(true[:3, :3], true[:3, 3], center, cell.radius_mm)
    rough = Estimate(
        rotation_from_vector(rng.normal(0, ROUGH_DEG * DEG, 3)) @ true[:3, :3],
        true[:3, 3] + rng.normal(0, ROUGH_MM, 3),
        center + rng.normal(0, ROUGH_MM, 3),
        cell.radius_mm,
    )
    nominal = rotation_from_rpy(*(np.array(recipe.robot.nominal_rpy_deg) * DEG)) @ true[:3, :3]
    x, _, z = in_profiler(scanner, np.zeros(3))
    limits = Limits(nominal, 25 * DEG, 25 * DEG, (float(x), float(z)), (10.0, 15.0))
    noise = Noise(radius_mm=cell.radius_mm)
    flange, centre = candidate_postures(limits, rough, CANDIDATES, rng)
    gain = information_gains(flange, centre, rough, noise, Optics(cell.noise_mm, cell.pitch_mm, -1))
    planned = _cell_at(cell, truth, flange[chosen_postures(gain, information_before(noise), POSTURES)])
    sets = [random_postures(limits, truth, POSTURES, rng)[0] for _ in range(RANDOM_SETS)]
    result.bound_mm = _bound(planned)
    result.random_mm = float(np.median([_bound(_cell_at(cell, truth, one)) for one in sets]))
    circle, covariance = circles(planned, rng)
    said = planned.turned.copy()
    said[:, :3, 3] += rng.normal(0, cell.pose_mm, (len(said), 3))
    said[:, :3, :3] @= rotation_from_vector(rng.normal(0, cell.pose_deg * DEG, (len(said), 3)))
    try:
        fit = solve(from_arrays(circle, covariance, said), noise, pose_from(rough.rotation, rough.translation_mm)).found
    except WorkbenchError as error:
        result.refused = str(error)
        return
    result.vol_mm = planned.vol_mm(pose_from(fit.estimate.rotation, fit.estimate.translation_mm))


def _cell_at(cell: Cell, truth: Estimate, flange: Float) -> Cell:
    """What the profiler truly sees from flange poses (k, 4, 4)."""
    here = np.einsum("kji,kj->ki", flange[:, :3, :3], truth.center_mm - flange[:, :3, 3])
    centre = (here - truth.translation_mm) @ truth.rotation
    seen = np.abs(centre[:, 1]) < REACH * cell.radius_mm  # the laser may miss the sphere where the plan was rough
    flange, centre = flange[seen], centre[seen]
    return Cell(
        cell.hand_eye, flange, centre, cell.radius_mm, cell.noise_mm, cell.pitch_mm, cell.pose_mm, cell.pose_deg
    )


def _bound(cell: Cell) -> float:
    covariance = circles(cell, np.random.default_rng(0))[1]
    return cell.vol_u_mm(bound(cell, covariance, 0.05))


def random_postures(limits: Limits, estimate: Estimate, count: int, rng: np.random.Generator) -> tuple[Float, Float]:
    """Postures drawn evenly within the same limits: what a plan is compared with."""
    way, tilt = rng.uniform(0, 2 * np.pi, count), limits.cone * np.sqrt(rng.random(count))
    low, high = limits.off_plane
    y = estimate.radius_mm * rng.uniform(low, high, count) * rng.choice([-1.0, 1.0], count)
    x, z = (m + h * rng.uniform(-1, 1, count) for m, h in zip(limits.middle_mm, limits.half_mm, strict=True))
    centre = np.stack([x, y, z], axis=1)
    tilts = np.stack([tilt * np.cos(way), tilt * np.sin(way)], axis=1)
    return poses(limits, estimate, tilts, limits.roll * rng.uniform(-1, 1, count), centre), centre


def information_before(noise: Noise) -> Float:
    """Information (10, 10) before any posture: the design's, and what is known of the sphere's radius."""
    spread = np.repeat([UNKNOWN_MM, UNKNOWN_RAD, UNKNOWN_CENTER_MM, noise.radius_u_mm], [3, 3, 3, 1])
    return np.diag(spread**-2)
