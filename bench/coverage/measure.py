"""One part through the stages as a user runs them, beside its truth. Only public results are used."""

from __future__ import annotations

import math
import time
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.coverage.parts import is_raw, part
from workbench.artefacts import ROUNDING, Recording
from workbench.cloud import denoise
from workbench.edge import segment, segment_raw
from workbench.errors import WorkbenchError
from workbench.geometry.poses import rotation_from_vector
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic.workpiece import build_surface, pose
from workbench.units import DEG, Bool, Float

BOUNDARY_MM = 1.0  # this near to the end of a hidden stretch either answer is right
MISPLACED_MM = 1.0  # an origin that far from the true lower edge is in the wrong place
STATION_MM = 5.0  # between the stations of a raw edge that are compared
LOCAL_MM = 10.0  # a rough end face is its least-squares plane over this much to both sides
MOST_TURNED_DEG = 10.0  # of `upper_side`, which a user knows roughly


@dataclass
class Result:
    """What was found of one part. Lists have an entry a section or a station; NaN: not measured."""

    condition: str
    seed: int
    title: str = ""
    refused: str = ""
    crashed: str = ""
    seconds: float = 0.0
    checks_failed: list[str] = field(default_factory=list)
    error: dict[str, Any] = field(default_factory=dict)  # quantity -> (k,) value less truth
    u: dict[str, Any] = field(default_factory=dict)  # quantity -> (k,)
    unseen_mm: float = 0.0  # of the root face's u: a rounding that the view does not show
    wanted: Any = None  # (k,) the truth is seen there
    covered: float = math.nan  # raw edge: share of the seen edge that was measured


Task = tuple[str, int, Path | None]  # condition, seed, folder for recordings


def measure_task(task: Task) -> Result:
    """`measure` for a pool, whose processes do not find what stands in a package's `__main__`."""
    return measure(*task)


def measure(condition: str, seed: int, kept: Path | None) -> Result:
    """Simulate (or fetch) a part, measure it and compare."""
    recording, truth = part(condition, seed, kept)
    result = Result(condition, seed, title=truth.recipe.title)
    start = time.process_time()
    try:
        found = measured_raw(recording, truth) if is_raw(condition) else measured_milled(recording, truth)
    except WorkbenchError as error:
        result.refused = str(error)
        return result
    except Exception as error:
        result.crashed = repr(error)
        return result
    finally:
        result.seconds = time.process_time() - start
    (compare_raw if is_raw(condition) else compare_milled)(result, found, truth)
    return result


def measured_milled(recording: Recording, truth: Any) -> Any:
    """The inspection, by the nominal values of the part's drawing: the true ones rounded to 0.5 mm and 5 deg."""
    root = max(0.5, round(float(truth.root_mm.mean()) * 2) / 2)
    bevel = round(float(truth.bevel_deg.mean()) / 5) * 5.0
    edge = segment(denoise(fuse(recording)), root_nominal_mm=root, bevel_nominal_deg=bevel)
    return sections(edge, root_nominal_mm=root, bevel_nominal_deg=bevel)


def measured_raw(recording: Recording, truth: Any) -> Any:
    """The raw edge, its upper side known to 10 deg."""
    recipe = truth.recipe
    rng = np.random.default_rng([recipe.seed, zlib.crc32(recipe.title.encode()), 1])
    across = truth.across[len(truth.across) // 2]
    axis = np.cross(across, rng.normal(size=3))
    turned = rotation_from_vector(axis / np.linalg.norm(axis) * rng.uniform(0, MOST_TURNED_DEG) * DEG) @ across
    z_away = recipe.scanner.z_away if recipe.title == "raw_square" else None
    robot = recipe.robot  # its slow errors are declared, since no scan shows them
    slow = math.hypot(
        getattr(robot, "drift_mm", 0.0) / math.sqrt(12), getattr(robot, "smooth_error_mm", 0.0) / math.sqrt(2)
    )
    upper_side = tuple(float(x) for x in turned)
    return segment_raw(denoise(fuse(recording)), upper_side=upper_side, z_away=z_away, robot_drift_u_mm=slow)


def compare_milled(result: Result, inspection: Any, truth: Any) -> None:
    """Errors of all sections. What is measured in the wrong place counts as its distance, at the u of the root."""

    def column(name: str) -> Float:
        return np.array([getattr(s, name) for s in inspection.sections], dtype=float)

    origin = np.array([s.origin_mm for s in inspection.sections], dtype=float)
    away = np.linalg.norm(origin - at(truth, origin, truth.position_mm), axis=1)
    result.wanted = seen_around(truth, origin)
    result.error = {
        "root_mm": column("root_mm") - truth.root_mm_at(origin),
        "bevel_deg": column("bevel_deg") - truth.bevel_deg_at(origin),
    }
    result.u = {"root_mm": column("root_u_mm"), "bevel_deg": column("bevel_u_deg")}
    result.unseen_mm = next((s.root_u_mm for s in inspection.uncertainty.sources if s.name == ROUNDING), 0.0)
    wrong = (away > MISPLACED_MM) & np.isfinite(result.error["root_mm"])
    result.error["root_mm"][wrong] = away[wrong]


def compare_raw(result: Result, edge: Any, truth: Any) -> None:
    """Errors of position along n and m, of the axis (turn of n about the edge) and the heading, some mm apart."""
    seen = np.flatnonzero(np.isfinite(edge.position_mm[:, 0]) & edge.seen)
    pitch = float(np.median(np.diff(edge.arc_length_mm)))
    some = seen[:: max(1, round(STATION_MM / pitch))]
    some = np.unique(np.append(some, seen[-1:]))
    place = edge.position_mm[some]
    position, normal, across, upper = local_face(truth)
    n, m, t = (unit(at(truth, place, v)) for v in (normal, across, truth.tangent))
    off = place - at(truth, place, position)
    u = np.full((len(some), 2), math.nan) if edge.position_u_mm is None else edge.position_u_mm[some]
    turn = np.arctan2((edge.normal[some] * m).sum(axis=1), (edge.normal[some] * n).sum(axis=1)) / DEG
    heading = np.arccos(np.clip((edge.tangent[some] * t).sum(axis=1), -1, 1)) / DEG
    result.wanted = seen_around(truth, place)
    result.error = {
        "normal_mm": (off * n).sum(axis=1),
        "across_mm": (off * m).sum(axis=1),
        "axis_deg": turn,
        "heading_deg": heading,
    }
    result.u = {
        "normal_mm": u[:, 0],
        "across_mm": u[:, 1],
        "axis_deg": np.broadcast_to(np.asarray(edge.normal_u) / DEG, (len(edge.seen),))[some],
        "heading_deg": np.full(len(some), math.nan),
    }
    if edge.upper_position_mm is not None:
        top = edge.upper_position_mm[some]
        result.error["upper_mm"] = ((top - at(truth, place, upper)) * m).sum(axis=1)
        result.u["upper_mm"] = np.full(len(some), math.nan)
    true, found = truth.position_mm[truth.seen], edge.position_mm[seen]
    if len(true):
        near = [np.linalg.norm(found - p, axis=1).min(initial=np.inf) <= 1.5 for p in true[::4]]
        result.covered = float(np.mean(near))


def at(truth: Any, position_mm: Float, values: Float) -> Float:
    """`values` of the truth's stations in the sections of base points (k, 3), linear between stations."""
    if hasattr(truth, "at"):
        return np.asarray(truth.at(position_mm, values))
    along = truth.arc_length_mm_at(position_mm)
    return np.stack([np.interp(along, truth.arc_length_mm, column) for column in values.T], axis=-1)


def seen_around(truth: Any, position_mm: Float) -> Bool:
    """Whether all of the true edge is seen within BOUNDARY_MM of the sections of base points (k, 3)."""
    along, stations = truth.arc_length_mm_at(position_mm), truth.arc_length_mm
    before = np.concatenate([[0], np.cumsum(truth.seen)])
    first = np.searchsorted(stations, along - BOUNDARY_MM)
    last = np.searchsorted(stations, along + BOUNDARY_MM, side="right")
    return np.asarray((before[last] - before[first] == last - first) & (last > first))


def local_face(truth: Any) -> tuple[Float, Float, Float, Float]:
    """Lower edge, n, m and upper edge at the truth's stations; on a rough face, of its local least-squares plane.

    The second simulator's truth is that plane already.
    """
    if hasattr(truth, "upper_position_mm"):
        return truth.position_mm, truth.normal, truth.across, truth.upper_position_mm
    width = truth.thickness_mm / (truth.across @ pose(truth.recipe.part.base_from_part)[:3, 2])
    upper = truth.position_mm + width[:, None] * truth.across
    waves = build_surface(truth.recipe.part, truth.recipe.seed).roughness
    if not len(waves):
        return truth.position_mm, truth.normal, truth.across, upper
    u = np.linspace(0.0, truth.recipe.part.length_mm, len(truth.arc_length_mm))
    share = np.linspace(0, 1, 64)
    height = np.zeros((len(u), len(share)))
    for amplitude, along, over, phase in waves:
        height += amplitude * np.cos(along * u[:, None] + over * share * width[:, None] + phase)
    wide = round(2 * LOCAL_MM / float(np.median(np.diff(u)))) + 1
    v = share - 0.5
    mean, slope = _running(height.mean(axis=1), wide), _running(height @ v / (v @ v), wide)
    lean = np.arctan2(slope, width)[:, None]
    return (
        truth.position_mm + (mean - slope / 2)[:, None] * truth.normal,
        np.cos(lean) * truth.normal - np.sin(lean) * truth.across,
        np.cos(lean) * truth.across + np.sin(lean) * truth.normal,
        upper + (mean + slope / 2)[:, None] * truth.normal,
    )


def _running(values: Float, wide: int) -> Float:
    window = np.ones(wide)  # the face ends with the part
    inside = np.convolve(np.ones(len(values)), window, mode="full")[wide // 2 : wide // 2 + len(values)]
    return np.convolve(values, window, mode="full")[wide // 2 : wide // 2 + len(values)] / inside


def unit(vectors: Float) -> Float:
    """Vectors (k, 3) at unit length."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
