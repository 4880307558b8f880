"""Milling paths planned from simulated raw edges as a user would, beside the bevel that the true lower edge implies."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.drawn.plates import RAW_CONDITIONS, random_recipe
from bench.metrology.places import clear_of_boundaries
from bench.metrology.study import HEAD, Condition, Row, Study, marked, spread
from bench.metrology.true_edge import true_edge_at
from bench.score.face import rough_upper_side
from workbench.artefacts import Gate, Layer, RawEdge, Recording, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment_raw
from workbench.errors import WorkbenchError
from workbench.geometry.poses import rotation_from_quaternion
from workbench.path import check, feed, layers
from workbench.scan import fuse
from workbench.synthetic import Truth, simulate_recording
from workbench.units import DEG, Bool, Float

NEAR_MM = 0.55  # a place along the edge this near to a cutting point is cut: points are 1 mm apart
REACH_MM = 20.0  # of the cutter's radius, clearance and rise: no more than that is lost beside a clamp
RIGHT_SIDE = 0.7  # least cosine of a frame's axes against the true ones
GOALS: dict[str, tuple[float, float] | None] = dict.fromkeys(RAW_CONDITIONS, (0.04, 0.1)) | {  # mm, deg
    "raw_rough": (0.06, 0.15),
    "raw_robot": None,  # the whole edge is displaced, and no recording shows it
}
SPACING_GOAL, LOST_GOAL = 0.05, 0.01
MOST_SEEN = 0.6  # an edge that is seen on less may be refused (`least_seen_share` of path.layers is 0.5)


def measure(condition: str, seed: int) -> Row:
    """Errors of the final layer; those of the edge that it rests on are the score's (`bench.score`)."""
    recording, truth = simulate_recording(random_recipe(condition, seed))
    row: Row = {"seen_share": float(truth.seen.mean())}
    try:
        edge, toolpath, gate = plan_as_a_user(recording, truth)
    except WorkbenchError as error:
        return row | {"refused": str(error)}
    invented = int(clear_of_boundaries(truth, edge.position_mm[edge.seen])[1].sum())
    row |= {"rejected": None if gate.passed else gate.reason, "invented": invented}
    return row | compare_path(toolpath, truth)


def plan_as_a_user(recording: Recording, truth: Truth) -> tuple[RawEdge, Toolpath, Gate]:
    """The stages of planning with all their defaults: the paper's bevel.

    Where nothing but the end face returns, the scan does not tell in which sense z counts: the user does.
    """
    recipe, cloud = truth.recipe, denoise(fuse(recording))
    z_away = recipe.scanner.z_away if recipe.title == "raw_square" else None
    edge = segment_raw(cloud, upper_side=rough_upper_side(truth), z_away=z_away)
    toolpath = feed(layers(edge, cloud), cloud, edge)
    return edge, toolpath, check(toolpath, edge, cloud)


def compare_path(toolpath: Toolpath, truth: Truth) -> Row:
    """Greatest errors of the final layer's cutting points, and how much of the seen edge they leave out."""
    final = toolpath.layers[-1]
    points = final.position_mm[final.cutting]
    true = true_edge_at(truth, points)
    axes = rotation_from_quaternion(final.quaternion_wxyz[final.cutting])
    x, y, z = axes[:, :, 0], axes[:, :, 1], axes[:, :, 2]
    height = true.height_mm(points, toolpath.root_mm, toolpath.bevel_deg)
    axis = true.cutter_axis(toolpath.bevel_deg)
    angle = np.arctan2(np.linalg.norm(np.cross(z, axis), axis=1), np.sum(z * axis, axis=1))
    into = -np.sum(x * true.bevel_normal(toolpath.bevel_deg), axis=1)
    cut = _within(NEAR_MM, truth.arc_length_mm, true.arc_length_mm)
    reachable = truth.seen & ~_beside_hidden(truth)
    return {
        "layers": len(toolpath.layers),
        "distance_mm": float(np.abs(height).max()),  # from the finished bevel, along its normal
        "axis_deg": float(angle.max() / DEG),  # of the cutter's axis against the true one
        "spacing": _spacing_error(final, true.arc_length_mm, toolpath.edge_length_mm, truth),
        "lost": 1.0 - float(cut[truth.seen].mean()),  # of the seen edge
        "reachable_lost": 1.0 - float(cut[reachable].mean()) if reachable.any() else None,  # clear of hidden stretches
        "wrong_side": bool(min(into.min(), np.sum(y * true.tangent, axis=1).min()) < RIGHT_SIDE),  # or fed backwards
        "blind": int(clear_of_boundaries(truth, points)[1].sum()),  # points that cut where the edge is hidden
    }


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
    return float(np.abs(spacing - 1.0).max()) if len(spacing) else None


def _within(reach_mm: float, at_mm: Float, points_mm: Float) -> Bool:
    """Which places along the edge lie so near to one of the points."""
    points = np.concatenate([[-np.inf], np.sort(points_mm), [np.inf]])
    after = np.searchsorted(points, at_mm)
    return np.asarray(np.minimum(at_mm - points[after - 1], points[after] - at_mm) <= reach_mm)


def _beside_hidden(truth: Truth) -> Bool:
    """Stations that a clamp may keep the cutter from: near to a hidden stretch within the seen edge."""
    first, *_, last = np.flatnonzero(truth.seen)
    return _within(REACH_MM, truth.arc_length_mm, truth.arc_length_mm[first:last][~truth.seen[first:last]])


def goals(c: Condition) -> Iterator[tuple[bool, str]]:
    in_view = sum(row["seen_share"] >= MOST_SEEN for row in c.having("refused"))
    rejected = len(c.having("rejected"))
    yield in_view > 0, f"{in_view} refused although most of the edge is in view"
    yield rejected > 0, f"{rejected} rejected by path.check"
    for name, words, goal in (
        ("distance_mm", "distance", _goal(c, 0)),
        ("axis_deg", "axis", _goal(c, 1)),
        ("spacing", "spacing", SPACING_GOAL),
        ("reachable_lost", "coverage of the edge", LOST_GOAL),
    ):
        yield goal is not None and not c.worst(name) <= goal, words
    yield c.total("wrong_side") > 0, "wrong side"
    yield c.total("blind") + c.total("invented") > 0, "invented edge"


def _goal(c: Condition, which: int) -> float | None:
    both = GOALS[c.name]
    return None if both is None else both[which]


def _most(c: Condition, name: str, digits: int, unit: float = 1.0) -> str:
    return spread(unit * c.at(name, 50, 95), digits)


STUDY = Study(
    conditions=tuple(RAW_CONDITIONS),
    parts=100,
    page="planning_metrology.md",
    measure=measure,
    goals=goals,
    outcomes=("refused", "crashed", "rejected"),
    tables=(
        (
            "Final layer: the worst point of each part; median and 95th percentile of the parts, worst",
            (
                *HEAD,
                ("from the bevel, mm", lambda c: _most(c, "distance_mm", 4)),
                ("worst", lambda c: marked(c.worst("distance_mm"), _goal(c, 0), 4)),
                ("axis, deg", lambda c: _most(c, "axis_deg", 3)),
                ("worst", lambda c: marked(c.worst("axis_deg"), _goal(c, 1))),
                ("spacing: worst, share", lambda c: marked(c.worst("spacing"), SPACING_GOAL)),
                ("seen edge not cut, %", lambda c: _most(c, "lost", 1, 100.0)),
                ("clear of hidden stretches: worst, share", lambda c: marked(c.worst("reachable_lost"), LOST_GOAL)),
                ("wrong side", lambda c: c.total("wrong_side")),
                ("cut, seen where hidden", lambda c: f"{c.total('blind')}, {c.total('invented')}"),
            ),
            None,
        ),
    ),
)
