"""One simulated raw edge: planned as a user would, beside the bevel that its true lower edge implies."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np

from bench.drawn.plates import random_recipe
from bench.metrology.part import Clock
from bench.metrology.places import clear_of_boundaries
from bench.metrology.true_edge import true_edge_at
from workbench.artefacts import Gate, Layer, RawEdge, Recording, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment_raw
from workbench.errors import WorkbenchError
from workbench.geometry.poses import rotation_from_quaternion, rotation_from_vector
from workbench.path import check, feed, layers
from workbench.scan import fuse
from workbench.synthetic import Truth, simulate_recording
from workbench.units import DEG, Bool, Float


@dataclass(slots=True)
class PlanResult:
    """Errors of the final layer; those of the edge that it rests on are the score's (`bench.score`)."""

    condition: str
    seed: int
    refused: str | None = None  # the stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    rejected: str | None = None  # by `path.check`, with its reason
    seen_share: float = 1.0  # of the part's edge, by truth
    layers: int = 0
    distance_mm: float | None = None  # greatest, of the cutting points from the finished bevel, along its normal
    axis_deg: float | None = None  # greatest angle of the cutter's axis against the true one
    spacing_error: float | None = None  # greatest |spacing - 1 mm| along the true lower edge, as a share
    covered: float | None = None  # share of the seen edge with cutting points
    reachable_covered: float | None = None  # likewise, of what is clear of hidden stretches
    wrong_side: bool = False  # the cutter on the wrong side, or fed backwards
    blind_points: int = 0  # that cut where the edge is hidden
    stations_invented: int = 0  # of the edge, said to be seen where it is hidden
    seconds: dict[str, float] = field(default_factory=dict)


MOST_TURNED_DEG = 10.0  # of `upper_side`, which a user knows roughly


def measure_plan(condition: str, seed: int) -> PlanResult:
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
    seen = edge.position_mm[edge.seen]
    result.stations_invented = int(clear_of_boundaries(truth, seen)[1].sum())
    compare_path(result, toolpath, truth)
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


NEAR_MM = 0.55  # a place along the edge this near to a cutting point is cut: points are 1 mm apart
REACH_MM = 20.0  # of the cutter's radius, clearance and rise: no more than that is lost beside a clamp
RIGHT_SIDE = 0.7  # least cosine of a frame's axes against the true ones


def compare_path(result: PlanResult, toolpath: Toolpath, truth: Truth) -> None:
    """Errors of the final layer's cutting points, and how much of the seen edge they cover."""
    final = toolpath.layers[-1]
    result.layers = len(toolpath.layers)
    points = final.position_mm[final.cutting]
    true = true_edge_at(truth, points)
    axes = rotation_from_quaternion(final.quaternion_wxyz[final.cutting])
    x, y, z = axes[:, :, 0], axes[:, :, 1], axes[:, :, 2]
    height = true.height_mm(points, toolpath.root_mm, toolpath.bevel_deg)
    axis = true.cutter_axis(toolpath.bevel_deg)
    angle = np.arctan2(np.linalg.norm(np.cross(z, axis), axis=1), np.sum(z * axis, axis=1))
    into = -np.sum(x * true.bevel_normal(toolpath.bevel_deg), axis=1)
    result.distance_mm = round(float(np.abs(height).max()), 6)
    result.axis_deg = round(float(angle.max() / DEG), 6)
    result.wrong_side = bool(min(into.min(), np.sum(y * true.tangent, axis=1).min()) < RIGHT_SIDE)
    result.blind_points = int(clear_of_boundaries(truth, points)[1].sum())
    result.spacing_error = _spacing_error(final, true.arc_length_mm, toolpath.edge_length_mm, truth)
    cut = _near(truth.arc_length_mm, true.arc_length_mm)
    result.covered = round(float(cut[truth.seen].mean()), 6)
    reachable = truth.seen & ~_beside_hidden(truth)
    result.reachable_covered = round(float(cut[reachable].mean()), 6) if reachable.any() else None


def _spacing_error(final: Layer, true_arc_length_mm: Float, length_mm: float, truth: Truth) -> float | None:
    """Greatest |spacing - 1 mm| of neighbouring key points that cut; the last interval may be shorter.

    What lies beyond the part's ends has no arc length of its own: the truth gives it that of the end.
    """
    key = np.flatnonzero(final.cutting)
    pairs = np.diff(key) == 1
    pairs &= final.arc_length_mm[key[1:]] < length_mm - 1e-6
    inside = (true_arc_length_mm > 1e-6) & (true_arc_length_mm < truth.arc_length_mm[-1] - 1e-6)
    pairs &= inside[:-1] & inside[1:]
    spacing = np.diff(true_arc_length_mm)[pairs]
    return round(float(np.abs(spacing - 1.0).max()), 6) if len(spacing) else None


def _near(at_mm: Float, points_mm: Float) -> Bool:
    """Which places along the edge lie near one of the points."""
    points = np.concatenate([[-np.inf], np.sort(points_mm), [np.inf]])
    after = np.searchsorted(points, at_mm)
    return np.asarray(np.minimum(at_mm - points[after - 1], points[after] - at_mm) <= NEAR_MM)


def _beside_hidden(truth: Truth) -> Bool:
    """Stations that a clamp may keep the cutter from: near to a hidden stretch within the seen edge."""
    at = truth.arc_length_mm
    first, *_, last = np.flatnonzero(truth.seen)
    hidden = at[first:last][~truth.seen[first:last]]
    if not len(hidden):
        return np.zeros(len(at), bool)
    hidden = np.concatenate([[-np.inf], hidden, [np.inf]])
    after = np.searchsorted(hidden, at)
    return np.asarray(np.minimum(at - hidden[after - 1], hidden[after] - at) <= REACH_MM)
