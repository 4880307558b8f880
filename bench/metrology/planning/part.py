"""One simulated raw edge: planned as a user would, beside the bevel that its true lower edge implies."""

from __future__ import annotations

import zlib

import numpy as np

from bench.metrology.part import Clock
from bench.metrology.planning.compare import compare_edge, compare_path
from bench.metrology.planning.result import PlanResult
from bench.metrology.true_edge import best_plane_turn_deg
from workbench.artefacts import Gate, RawEdge, Recording, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment_raw
from workbench.errors import WorkbenchError
from workbench.geometry.poses import rotation_from_vector
from workbench.path import check, feed, layers
from workbench.scan import fuse
from workbench.synthetic import Truth, random_recipe, simulate_recording
from workbench.units import DEG

MOST_TURNED_DEG = 10.0  # of `upper_side`, which a user knows roughly


def measure_plan(condition: str, seed: int, peers: tuple[str, ...] = ()) -> PlanResult:
    """Simulate raw edge `seed` of a condition, plan its milling and compare with its truth. There are no peers."""
    result = PlanResult(condition, seed)
    clock = Clock(result.seconds)
    recording, truth = simulate_recording(random_recipe(condition, seed))
    result.seen_share = float(truth.seen.mean())
    clock.lap("simulation")
    try:
        edge, toolpath, gate = plan_as_a_user(recording, truth, clock)
    except WorkbenchError as error:
        result.refused = str(error)
        return result
    except Exception as error:
        result.crashed = repr(error)
        return result
    result.rejected = None if gate.passed else gate.reason
    compare_edge(result, edge, truth)
    compare_path(result, toolpath, truth)
    result.plane_deg = round(best_plane_turn_deg(truth), 6)
    return result


def plan_as_a_user(recording: Recording, truth: Truth, clock: Clock) -> tuple[RawEdge, Toolpath, Gate]:
    """The stages of planning with all their defaults: the paper's bevel.

    Where nothing but the end face returns, the scan does not tell in which sense z counts: the user does.
    """
    recipe, cloud = truth.recipe, denoise(fuse(recording))
    z_away = recipe.scanner.z_away if recipe.title == "raw_square" else None
    edge = segment_raw(cloud, upper_side=rough_upper_side(truth), z_away=z_away)
    clock.lap("edge")
    toolpath = layers(edge, cloud)
    clock.lap("layers")
    toolpath = feed(toolpath, cloud, edge)
    clock.lap("feed")
    gate = check(toolpath, edge, cloud)
    clock.lap("check")
    return edge, toolpath, gate


def rough_upper_side(truth: Truth) -> tuple[float, float, float]:
    """The true direction from the lower to the upper side, turned by up to 10 deg about any axis square to it."""
    rng = np.random.default_rng([truth.recipe.seed, zlib.crc32(truth.recipe.title.encode()), 1])
    across = truth.across[len(truth.across) // 2]
    axis = np.cross(across, rng.normal(size=3))
    turned = rotation_from_vector(axis / np.linalg.norm(axis) * rng.uniform(0, MOST_TURNED_DEG) * DEG) @ across
    return float(turned[0]), float(turned[1]), float(turned[2])
