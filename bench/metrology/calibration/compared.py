"""The methods side by side on the same circles, and planned postures beside random ones."""

from __future__ import annotations

import numpy as np

from bench.metrology.calibration.result import CalibrationResult
from bench.metrology.calibration.truth import Cell, bound, cell_of, circles
from bench.peers.genetic import genetic_hand_eye
from workbench.errors import WorkbenchError
from workbench.geometry.poses import pose_from, rotation_from_rpy, rotation_from_vector
from workbench.plugins.calibration import bundle, methods
from workbench.plugins.calibration.model import Estimate, Noise, linearise
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.plan import (
    Limits,
    Optics,
    candidate_postures,
    chosen_postures,
    information_before,
    information_gains,
    random_postures,
)
from workbench.plugins.calibration.solve import Answer, solve
from workbench.synthetic import SphereRecipe
from workbench.synthetic.sphere import in_profiler
from workbench.synthetic.workpiece import pose as placed
from workbench.units import DEG, Float

POSTURES, RANDOM_SETS, CANDIDATES = 9, 40, 800
REACH = 0.95  # of |y| in radii, beyond which the circle is too small
ROUGH_MM, ROUGH_DEG = 0.2, 0.1  # what the hand-eye pose is off, each axis, when the plan is made


def compare_methods(result: CalibrationResult, cell: Cell, answer: Answer, design: Float) -> None:
    """Every method on the centres, signs and postures that the bundle has found."""
    fit = answer.fit
    seen = answer.seen.subset(fit.used)
    P = bundle.signed_centres(fit.estimate, linearise(fit.estimate, seen, answer.noise), seen)
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
    gain = information_gains(flange, centre, rough, noise, Optics(cell.noise_mm, cell.pitch_mm))
    planned = _cell_at(cell, truth, flange[chosen_postures(gain, information_before(noise), POSTURES)])
    sets = [random_postures(limits, truth, POSTURES, rng)[0] for _ in range(RANDOM_SETS)]
    result.bound_mm = _bound(planned)
    result.random_mm = float(np.median([_bound(_cell_at(cell, truth, one)) for one in sets]))
    circle, covariance = circles(planned, rng)
    said = planned.turned.copy()
    said[:, :3, 3] += rng.normal(0, cell.pose_mm, (len(said), 3))
    said[:, :3, :3] @= rotation_from_vector(rng.normal(0, cell.pose_deg * DEG, (len(said), 3)))
    try:
        fit = solve(from_arrays(circle, covariance, said), noise, pose_from(rough.rotation, rough.translation_mm)).fit
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
