"""One simulated calibration, measured against its truth."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.metrology.calibration.compared import compare_methods, measure_plan
from bench.metrology.calibration.result import CalibrationResult
from bench.metrology.calibration.truth import Cell, bound, cell_of, circles
from bench.metrology.part import Clock
from workbench.errors import WorkbenchError
from workbench.plugins.calibration import circles as find_circles
from workbench.plugins.calibration import hand_eye
from workbench.plugins.calibration.hand_eye import pose_from
from workbench.plugins.calibration.model import Estimate, Noise, information, linearise
from workbench.plugins.calibration.observations import Observations, by_pass, from_arrays
from workbench.plugins.calibration.shared_errors import correlated
from workbench.plugins.calibration.solve import Answer, solve
from workbench.synthetic import SphereRecipe, random_sphere_recipe, simulate_sphere
from workbench.synthetic.sphere import design_hand_eye, sphere_motion
from workbench.units import Float

SCANS = ("sphere_scans", "sphere_weaved", "sphere_scans_common", "sphere_weaved_common")
PROFILES = ("sphere_stray", *SCANS, "scans_alike")  # these are measured from the points on
UNKNOWN_RADIUS_MM = 5.0
RADIUS_U_MM = 0.05
CLEAR_MM = 0.5  # six sigma of a recorded pose: a centre nearer to the laser plane has no side
WITHIN = 1.96  # standard uncertainties: 95 % of a normal error
WRONG = 10.0  # standard deviations over the field of view


def measure_calibration(condition: str, seed: int, peers: tuple[str, ...] = ()) -> CalibrationResult:
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
        other, _ = correlated(answer.fit, answer.seen, noise)
        pose = pose_from(other.estimate.rotation, other.estimate.translation_mm)
        result.correlated_nees = _nees(cell, pose, other.covariance[:6, :6])
        result.correlated_vol_mm = cell.vol_mm(pose)
    if result.condition == "sphere_grid":
        compare_methods(result, cell, answer, design_hand_eye(recipe))


def _compare(result: CalibrationResult, cell: Cell, answer: Answer, seen: Observations, kept: Any) -> None:
    """Error, uncertainty, signs and what was said."""
    estimate, covariance = answer.fit.estimate, answer.fit.covariance[:6, :6]
    pose = pose_from(estimate.rotation, estimate.translation_mm)
    _errors(result, cell, pose, covariance)
    y = linearise(estimate, seen, answer.noise).centre[:, 1]
    clear = kept & (np.abs(cell.centre[:, 1]) > CLEAR_MM)
    result.signs_wrong = int((np.sign(y) != np.sign(cell.centre[:, 1]))[clear].sum())
    if not kept.all():
        result.gross_found = not answer.fit.used[~kept].any()
    result.sound_rejected = int((~answer.fit.used[kept]).sum())
    result.flagged = answer.misfit
    result.warned = result.flagged or not answer.alone or not answer.fit.used.all()


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
