"""Hand-eye calibration beside the paper's genetic algorithm. `python -m bench.speed.calibration` prints JSON.

It runs in a process of its own, on one core. Both sides get the same circles; the genetic algorithms get the signs of h
as well, which `solve` has to find.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from bench.drawn.spheres import random_sphere_recipe
from bench.metrology.calibration.part import recorded
from bench.metrology.calibration.truth import cell_of, circles
from bench.peers.genetic import genetic_hand_eye
from bench.speed.timing import REPEATS, print_on_one_core
from workbench.geometry.poses import pose_from, rotation_from_rpy, rpy_from_rotation
from workbench.plugins import calibration
from workbench.plugins.calibration.methods import BOX_MM, BOX_RAD, GENERATIONS, POPULATION, Centres, _Pairs
from workbench.plugins.calibration.model import Noise, linearise, signed_centres
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.solve import solve
from workbench.scan import read
from workbench.synthetic import write_simulation
from workbench.synthetic.sphere import design_hand_eye
from workbench.units import Float

SETS = 10  # of nine postures, drawn anew
FIRST_SEED = 500_000


def one_by_one(design: Float, seen: Centres, seed: int) -> Float:
    """Hand-eye pose (4, 4) by the paper's two steps with scipy's differential evolution, an individual at a time."""
    pairs = _Pairs(seen)
    rpy = np.array(rpy_from_rotation(design[:3, :3]))

    def evolve(cost: Callable[[Float], float], middle: Float, half: float) -> Float:
        box = [(m - half, m + half) for m in middle]
        found = differential_evolution(
            cost,
            box,
            popsize=POPULATION // 3,
            maxiter=GENERATIONS,
            tol=0.0,
            polish=False,
            rng=np.random.default_rng(seed),
        )
        return np.asarray(found.x)

    angles = evolve(lambda g: float(np.sum(pairs.rotation_residual(rotation_from_rpy(*g)[None]) ** 2)), rpy, BOX_RAD)
    R = rotation_from_rpy(*angles)
    return pose_from(R, evolve(lambda g: float(pairs.translation_cost(R, g[None])[0]), design[:3, 3], BOX_MM))


def measure() -> dict[str, Any]:
    """Medians of processor time in s, RMS errors over the field of view in mm, of all methods over the same sets."""
    times: dict[str, list[float]] = {}
    errors: dict[str, list[float]] = {}

    def timed(name: str, repeats: int, way: Callable[..., Any], *given: Any) -> Any:
        for _ in range(repeats):
            start = time.process_time()
            found = way(*given)
            times.setdefault(name, []).append(time.process_time() - start)
        return found

    for k in range(SETS):
        recipe = random_sphere_recipe("sphere_nine", FIRST_SEED + k)
        cell, design, noise = cell_of(recipe), design_hand_eye(recipe), Noise()
        circle, covariance = circles(cell, np.random.default_rng(k))
        seen = from_arrays(circle, covariance, recorded(recipe))
        if k == 0:
            solve(seen, noise, design)  # kernels are loaded
        estimate = timed("ours", REPEATS, solve, seen, noise, design).found.estimate
        P = signed_centres(estimate, linearise(estimate, seen, noise), seen)
        centres = Centres(P, seen.base_from_flange[:, :3, :3], seen.base_from_flange[:, :3, 3])
        answers = {
            "ours": pose_from(estimate.rotation, estimate.translation_mm),
            "GA": timed("GA", 1, genetic_hand_eye, design, centres, np.random.default_rng(k)),
            "DE": timed("DE", 1, one_by_one, design, centres, k),
        }
        for name, pose in answers.items():
            errors.setdefault(name, []).append(cell.vol_mm(pose))
    return {
        "seconds": {name: statistics.median(each) for name, each in times.items()},
        "vol_mm": {name: float(np.sqrt(np.mean(np.square(each)))) for name, each in errors.items()},
        "file_s": file_to_answer(),
        "sets": SETS,
    }


def file_to_answer() -> float:
    """From a file of nine profiles to handeye.json in this process: the median; what is imported is there."""
    taken = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sphere.h5"
        write_simulation(random_sphere_recipe("sphere_stray", FIRST_SEED), path)
        for _ in range(REPEATS):
            start = time.perf_counter()
            recording = read(recording=path)
            profiles = calibration.circles(recording)
            calibration.hand_eye(profiles, recording)
            taken.append(time.perf_counter() - start)
    return statistics.median(taken)


if __name__ == "__main__":
    print_on_one_core(measure)
