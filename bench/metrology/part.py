"""One simulated part: inspected as a user would, beside its truth, the bound and other methods."""

from __future__ import annotations

import time
import zlib

import numpy as np

from bench.metrology.bound import bounds_at
from bench.metrology.information import exact_rays, frame_information, informative
from bench.metrology.others import PEERS
from bench.metrology.part_result import PartResult, numbers
from bench.metrology.places import clear_of_boundaries, parameter_at
from workbench.artefacts import ROUNDING, Inspection, Recording, Requirements
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.errors import WorkbenchError
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import Truth, random_recipe, simulate_recording

FIXED = ("paper", "limit")  # conditions drawn about the default requirements


def measure_part(condition: str, seed: int, peers: tuple[str, ...] = ()) -> PartResult:
    """Simulate part `seed` of a condition, inspect it and compare with its truth.

    peers, of 'per_profile' and 'open3d', measure the part too; with any of them comes the bound that noise allows.
    """
    result = PartResult(condition, seed)
    clock = Clock(result.seconds)
    recipe = random_recipe(condition, seed)
    recording, truth = simulate_recording(recipe)
    result.seen_share = float(truth.seen.mean())
    clock.lap("simulation")
    try:
        inspection = inspect_as_a_user(recording, truth)
    except WorkbenchError as error:
        result.refused = str(error)
        return result
    except Exception as error:
        result.crashed = repr(error)
        return result
    clock.lap("inspection")
    compare(result, inspection, truth)
    if not peers:
        result.root_bound_mm = result.bevel_bound_deg = [None] * len(inspection.sections)
        return result
    rays = exact_rays(recipe)
    frames = frame_information(recipe, rays, informative(recipe, rays, recording), recording.pass_index)
    origins = np.array([s.origin_mm for s in inspection.sections])
    bounds = bounds_at(recipe, frames, parameter_at(truth, origins))
    result.root_bound_mm, result.bevel_bound_deg = numbers(bounds.root_mm), numbers(bounds.bevel_deg)
    clock.lap("bound")
    for name in peers:
        result.peers[name] = PEERS[name](recording, truth, rays, frames)
        clock.lap(name)
    return result


class Clock:
    """Puts the seconds between laps into `laps`, by name."""

    def __init__(self, laps: dict[str, float]) -> None:
        self.laps, self._last = laps, time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self._last = round(now - self._last, 3), now


def inspect_as_a_user(recording: Recording, truth: Truth) -> Inspection:
    """The pipeline with all its defaults, but for what the part's drawing says: rounded to 0.5 mm and 5 deg."""
    required = requirements(truth)
    edge = segment(
        denoise(fuse(recording)),
        root_nominal_mm=max(0.5, round(float(truth.root_mm.mean()) * 2) / 2),
        bevel_nominal_deg=round(float(truth.bevel_deg.mean()) / 5) * 5.0,
    )
    return sections(
        edge,
        root_nominal_mm=required.root_nominal_mm,
        root_tolerance_mm=required.root_tolerance_mm,
        bevel_nominal_deg=required.bevel_nominal_deg,
        bevel_tolerance_deg=required.bevel_tolerance_deg,
    )


def requirements(truth: Truth) -> Requirements:
    """Requirements about the part's true values: some parts conform to them, some do not, some lie at a limit."""
    default = Requirements()
    if truth.recipe.title in FIXED:
        return default
    rng, nominal = np.random.default_rng([truth.recipe.seed, zlib.crc32(truth.recipe.title.encode())]), []
    for true, tolerance in ((truth.root_mm, default.root_tolerance_mm), (truth.bevel_deg, default.bevel_tolerance_deg)):
        inside, at_limit, outside = rng.uniform(0, 0.5), 1 + rng.uniform(-0.1, 0.1), rng.uniform(1.2, 2)
        off = rng.choice([-1, 1]) * rng.choice([inside, at_limit, outside], p=[0.5, 0.3, 0.2]) * tolerance[1]
        nominal.append(max(0.01, float(true.mean() + off)))
    return Requirements(root_nominal_mm=nominal[0], bevel_nominal_deg=nominal[1])


def compare(result: PartResult, inspection: Inspection, truth: Truth) -> None:
    """Put values, truth and verdicts of all sections into the result."""
    found, profile = inspection.sections, inspection.profile
    origins = np.array([s.origin_mm for s in found])
    result.root_mm, result.root_u_mm = [s.root_mm for s in found], [s.root_u_mm for s in found]
    result.root_unseen_u_mm = next((s.root_u_mm for s in inspection.uncertainty.sources if s.name == ROUNDING), 0.0)
    result.bevel_deg, result.bevel_u_deg = [s.bevel_deg for s in found], [s.bevel_u_deg for s in found]
    result.root_true_mm = numbers(truth.root_mm_at(origins))
    result.bevel_true_deg = numbers(truth.bevel_deg_at(origins))
    seen, hidden = clear_of_boundaries(truth, origins)
    result.seen, result.hidden = seen.tolist(), hidden.tolist()
    result.verdicts = [s.verdict for s in found]
    result.margins = [margin(result, inspection.requirements, i) for i in range(len(found))]
    claimed = np.isfinite(profile.root_mm) & np.isfinite(profile.position_mm[:, 0])
    result.stations_invented = int(clear_of_boundaries(truth, profile.position_mm[claimed])[1].sum())


def margin(result: PartResult, required: Requirements, i: int) -> float | None:
    """How far inside its nearest limit the truth of section i lies, in standard uncertainties; below 0: outside."""
    inside: list[float] = []
    for true, u, nominal, (low, high) in (
        (result.root_true_mm[i], result.root_u_mm[i], required.root_nominal_mm, required.root_tolerance_mm),
        (result.bevel_true_deg[i], result.bevel_u_deg[i], required.bevel_nominal_deg, required.bevel_tolerance_deg),
    ):
        if true is None or u is None:
            return None
        inside.append(min(true - nominal - low, nominal + high - true) / u)
    return round(min(inside), 3)
