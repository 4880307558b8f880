"""What a swept part is, exactly: virtual lower edge, section axes, root face and bevel angle along it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from bench.simulators.swept.recipe import GrooveRecipe, ScanRecipe, SweptRecipe
from bench.simulators.swept.scanner import Relief
from bench.simulators.swept.sweep import (
    Curve,
    groove_sizes,
    outline_of,
    preparation_sizes,
    virtual_edges,
)
from workbench.synthetic.groove_truth import PLACES, GrooveTruth, Stations, rounded
from workbench.synthetic.workpiece import pose, seen_near
from workbench.units import DEG, Bool, Float, Shaped

STATION_MM = 0.25
LOCAL_MM = 10.0  # the end face of a rough part is its least-squares plane over this much to both sides


@dataclass(frozen=True, slots=True, eq=False)
class SweptTruth(Stations):
    """The part as built, at stations along the virtual lower edge; arrays have one row per station."""

    recipe: SweptRecipe
    upper_position_mm: Shaped[Float, "n 3"]  # upper edge of the root face, or of the end face of a raw part
    normal: Shaped[Float, "n 3"]  # outward normal of the root face or end face
    across: Shaped[Float, "n 3"]
    root_mm: Shaped[Float, " n"]  # NaN on a raw part
    bevel_deg: Shaped[Float, " n"]  # NaN on a raw part
    thickness_mm: Shaped[Float, " n"]
    preparation: Mapping[str, Float]  # (n,) each: sizes by the names of `preparation.json`; empty on a raw part

    def root_mm_at(self, position_mm: Float) -> Float:
        """Root face (...,) in the sections of base points (..., 3)."""
        return self.at(position_mm, self.root_mm)

    def bevel_deg_at(self, position_mm: Float) -> Float:
        """Bevel angle (...,) in the sections of base points (..., 3)."""
        return self.at(position_mm, self.bevel_deg)

    def document(self) -> dict[str, Any]:
        """The content of a truth file: strict JSON, null for what is not."""
        names = (*PLACES, "upper_position_mm", "root_mm", "bevel_deg", "thickness_mm")
        return {
            "format": "bevel-truth",
            "version": 1,
            "frame": "base",
            "simulator": "swept",
            "seed": self.recipe.seed,
            "kind": self.recipe.part.kind,
            "closed": self.closed,
            **{name: rounded(getattr(self, name)) for name in names},
            "preparation": {name: rounded(value) for name, value in self.preparation.items()},
            "seen": self.seen.tolist(),
            "base_from_part": pose(self.recipe.part.base_from_part).tolist(),
            "flange_from_profiler": pose(self.recipe.robot.flange_from_profiler).tolist(),
            "recipe": self.recipe.model_dump(mode="json"),
        }


def truth_of(recipe: SweptRecipe, curve: Curve, relief: Relief | None, seen_s: list[Float]) -> SweptTruth:
    """The truth; `seen_s`: of each pass, where along the spine its frames saw the edge."""
    part = recipe.part
    frames = curve.stations(round(curve.length / STATION_MM) + 1)
    s = frames.s
    edges = virtual_edges(part, outline_of(part, s, curve.length))
    thickness = part.thickness_mm.at(s, curve.length)
    lower, upper = edges.lower.copy(), edges.upper.copy()
    lean = np.zeros(len(s))
    if relief is not None:
        lean = _fitted_relief(relief, s, lower, upper)
    position = frames.position + lower[:, :1] * frames.n + lower[:, 1:] * frames.m
    top = frames.position + upper[:, :1] * frames.n + upper[:, 1:] * frames.m
    up = np.cos(lean)[:, None] * frames.m + np.sin(lean)[:, None] * frames.n
    # the tangent is the lower edge's own, on a wavy root face or an edge that stands off the spine
    slope = np.gradient(position, s, axis=0, edge_order=2) if relief is None else local_slope(position)
    t = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    n = np.cross(t, up)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    m = np.cross(n, t)
    outward = np.cos(edges.bevel)[:, None] * frames.n + np.sin(edges.bevel)[:, None] * frames.m
    bevel = np.arctan2((outward * m).sum(axis=1), (outward * n).sum(axis=1))
    base = pose(part.base_from_part)
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return SweptTruth(
        recipe=recipe,
        closed=curve.closed,
        arc_length_mm=np.concatenate([[0.0], np.cumsum(step)]),
        position_mm=position @ base[:3, :3].T + base[:3, 3],
        upper_position_mm=top @ base[:3, :3].T + base[:3, 3],
        tangent=t @ base[:3, :3].T,
        normal=n @ base[:3, :3].T,
        across=m @ base[:3, :3].T,
        root_mm=edges.root_mm,
        bevel_deg=bevel / DEG,
        thickness_mm=thickness,
        preparation=preparation_sizes(part, s, curve.length) if part.kind == "milled" else {},
        seen=_seen(s, seen_s, recipe, curve),
    )


def groove_truth(recipe: GrooveRecipe, curve: Curve, seen_s: list[Float]) -> GrooveTruth:
    """The truth of a groove; `seen_s` as for `truth_of`."""
    frames = curve.stations(round(curve.length / STATION_MM) + 1)
    s = frames.s
    base = pose(recipe.part.base_from_part)
    turn = base[:3, :3].T
    return GrooveTruth(
        closed=curve.closed,
        arc_length_mm=s,
        position_mm=frames.position @ turn + base[:3, 3],
        tangent=frames.t @ turn,
        seen=_seen(s, seen_s, recipe, curve),
        recipe=recipe,
        simulator="swept",
        type=recipe.part.groove,
        normal=frames.n @ turn,
        across=frames.m @ turn,
        sizes=groove_sizes(recipe.part, s, curve.length),
        base_from_part=base,
        flange_from_profiler=pose(recipe.robot.flange_from_profiler),
    )


def _fitted_relief(relief: Relief, s: Float, lower: Float, upper: Float) -> Float:
    """Shift `lower` and `upper` to the face's local least-squares plane, in place; its lean (n,) in rad."""
    share = np.linspace(0.0, 1.0, 64)
    b = lower[:, 1:] + share * (upper[:, 1:] - lower[:, 1:])
    low, high = local_plane(relief.at(s[:, None], b), STATION_MM)
    lower[:, 0] += low
    upper[:, 0] += high
    return np.asarray(np.arctan2(high - low, b[:, -1] - b[:, 0]))


def local_plane(height: Float, station_mm: float) -> tuple[Float, Float]:
    """Where the least-squares plane of heights (n, k), k places across a face, lies at its lower and upper edge (n,).

    Of each station over `LOCAL_MM` to both sides; the face ends with the part.
    """
    wide = round(2 * LOCAL_MM / station_mm) + 1
    v = np.linspace(-0.5, 0.5, height.shape[1])
    inside = scipy.ndimage.uniform_filter1d(np.ones(len(height)), wide, mode="constant")
    columns = height.mean(axis=1), height @ v / (v @ v)
    mean, slope = (scipy.ndimage.uniform_filter1d(one, wide, mode="constant") / inside for one in columns)
    return mean - slope / 2, mean + slope / 2


def local_slope(position: Float) -> Float:
    """Mean way (n, 3) from station to station, over `LOCAL_MM` to both sides, of places (n, 3) of such a plane."""
    step = np.gradient(position, axis=0)
    wide = round(2 * LOCAL_MM / float(np.linalg.norm(step, axis=1).mean())) + 1
    return np.asarray(scipy.ndimage.uniform_filter1d(step, wide, axis=0, mode="nearest"))


def _seen(s: Float, seen_s: list[Float], recipe: ScanRecipe, curve: Curve) -> Bool:
    turns = (0.0, curve.length, -curve.length) if curve.closed else (0.0,)
    return seen_near(s, [np.concatenate([at + t for t in turns]) for at in seen_s], recipe.robot.frame_pitch_mm)
