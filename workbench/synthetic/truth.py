"""What a synthetic recording was made from, exactly: the lower edge in the base, root face and bevel angle along it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.geometry.poses import inverse
from workbench.strict_json import read_json
from workbench.synthetic import raycast
from workbench.synthetic.recipe import Recipe
from workbench.synthetic.recipe_file import parse_recipe
from workbench.synthetic.workpiece import (
    Cut,
    Workpiece,
    arc_length,
    build_surface,
    course_values,
    edge_frames,
    end_face_axes,
    pose,
    profile_sizes,
)
from workbench.units import DEG, Bool, Float, Shaped

STATION_MM = 0.5
FORMAT, VERSION = "bevel-truth", 1


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The part as built. Stations lie every 0.5 mm or so along the lower edge, from the part's start to its end.

    Root face (mm) and bevel angle (deg) hold in the section plane, normal to the tangent; both are NaN on a raw edge,
    and as cut on a part that was milled in simulation.
    Arc length counts from the part's start, seen or not: a measured edge begins at its first seen point.
    """

    recipe: Recipe
    arc_length_mm: Shaped[Float, " n"]
    position_mm: Shaped[Float, "n 3"]  # lower edge in the base
    tangent: Shaped[Float, "n 3"]  # t = m x n
    normal: Shaped[Float, "n 3"]  # outward normal of the root face or end face
    across: Shaped[Float, "n 3"]  # m: from the lower to the upper side
    root_mm: Shaped[Float, " n"]
    bevel_deg: Shaped[Float, " n"]
    thickness_mm: Shaped[Float, " n"]
    seen: Shaped[Bool, " n"]  # False: under a clamp, or outside the scan
    _parameter: Shaped[Float, " n"] = field(repr=False)  # u of the stations
    _surface: raycast.Surface = field(repr=False)

    def root_mm_at(self, position_mm: Float) -> Float:
        """Root face (...,) at the section of the base points (..., 3): that of the nearest point of the lower edge."""
        u = self._parameter_at(position_mm)
        if self._surface.milled:
            return course_values(self._surface.root, u)
        return np.interp(u, self._parameter, self.root_mm)

    def bevel_deg_at(self, position_mm: Float) -> Float:
        """Bevel angle (...,) at the section of the base points (..., 3)."""
        u = self._parameter_at(position_mm)
        if self._surface.milled:
            return course_values(self._surface.bevel, u) / DEG
        return np.interp(u, self._parameter, self.bevel_deg)

    def arc_length_mm_at(self, position_mm: Float) -> Float:
        """Arc length (...,) of the sections of the base points (..., 3), from the part's start."""
        u = self._parameter_at(position_mm)
        return np.interp(u, self._parameter, self.arc_length_mm)

    def seen_at(self, position_mm: Float) -> Bool:
        """Whether the station nearest to each base point (..., 3) was seen."""
        u = self._parameter_at(position_mm)
        nearest = np.rint(np.interp(u, self._parameter, np.arange(len(self._parameter)))).astype(int)
        within = (u > self._parameter[0] - STATION_MM) & (u < self._parameter[-1] + STATION_MM)
        return np.asarray(self.seen[nearest] & within)

    def _parameter_at(self, position_mm: Float) -> Float:
        part_from_base = inverse(pose(self.recipe.part.base_from_part))
        points = np.asarray(position_mm, dtype=float) @ part_from_base[:3, :3].T + part_from_base[:3, 3]
        u = raycast.project_all(self._surface, points.reshape(-1, 3))[:, 0]
        return np.asarray(u.reshape(points.shape[:-1]))

    def document(self) -> dict[str, Any]:
        """The content of a truth file: strict JSON, null for what is not."""
        columns = {
            name: _rounded(getattr(self, name))
            for name in ("arc_length_mm", "position_mm", "tangent", "normal", "across", "root_mm", "bevel_deg")
        }
        return {
            "format": FORMAT,
            "version": VERSION,
            "frame": "base",
            "seed": self.recipe.seed,
            "kind": "milled" if np.isfinite(self.root_mm).any() else "raw",
            **columns,
            "thickness_mm": _rounded(self.thickness_mm),
            "seen": self.seen.tolist(),
            "base_from_part": pose(self.recipe.part.base_from_part).tolist(),
            "flange_from_profiler": pose(self.recipe.robot.flange_from_profiler).tolist(),
            "recipe": self.recipe.model_dump(mode="json"),
        }


def build_truth(recipe: Recipe, seen_parameters: list[Float] | None = None, cut: Cut | None = None) -> Truth:
    """The truth of `recipe`, less what was cut; `seen_parameters`: where each pass's frames saw it, none: all of it."""
    part = recipe.part
    surface = build_surface(part, recipe.seed)
    u = np.linspace(0.0, part.length_mm, round(part.length_mm / STATION_MM) + 1)
    base_from_edge = pose(part.base_from_part) @ edge_frames(surface, u)
    outward, up = base_from_edge[:, :3, 0], base_from_edge[:, :3, 2]
    normal, across = end_face_axes(surface, u, outward, up)
    root, bevel_deg = _as_ordered(surface, u) if cut is None else profile_sizes(cut, u)
    return Truth(
        recipe=recipe,
        arc_length_mm=arc_length(surface, u),
        position_mm=base_from_edge[:, :3, 3],
        tangent=base_from_edge[:, :3, 1],
        normal=normal,
        across=across,
        root_mm=root,
        bevel_deg=bevel_deg,
        thickness_mm=course_values(surface.thickness, u),
        seen=_seen(u, seen_parameters, recipe.robot.frame_pitch_mm),
        _parameter=u,
        _surface=surface,
    )


def milled_truth(workpiece: Workpiece) -> Truth:
    """The truth of a workpiece as it is now: root face and bevel angle as cut, NaN where no face was cut.

    In each section a line is fitted to the cut profile between the root edge and the upper edge; the root ends where
    it meets the end face. Between the stations both are interpolated.
    """
    return build_truth(workpiece.recipe, cut=workpiece.cut)


def _as_ordered(surface: raycast.Surface, u: Float) -> tuple[Float, Float]:
    """Root face and bevel angle (deg) at u as the recipe states them; NaN on a raw edge."""
    if not surface.milled:
        return np.full(len(u), np.nan), np.full(len(u), np.nan)
    return course_values(surface.root, u), course_values(surface.bevel, u) / DEG


def read_truth(path: str | Path) -> Truth:
    """The truth in the file `path` (format bevel-truth), built anew from its recipe; InputError if it is none."""
    document = read_json(Path(path))
    if (document.get("format"), document.get("version")) != (FORMAT, VERSION):
        raise InputError(str(path), f"format '{FORMAT}', version {VERSION}")
    truth = build_truth(parse_recipe(document.get("recipe"), source=str(path)))
    seen = document.get("seen")
    if not isinstance(seen, list) or len(seen) != len(truth.seen):
        raise InputError(f"{path}: seen", f"a list of {len(truth.seen)} values, one a station")
    truth.seen[:] = seen
    return truth


def _seen(u: Float, seen_parameters: list[Float] | None, frame_pitch_mm: float) -> Bool:
    """Stations within three quarters of the frame pitch of a frame that sees the edge."""
    if seen_parameters is None:
        return np.ones(len(u), dtype=bool)
    seen = np.zeros(len(u), dtype=bool)
    for at in seen_parameters:
        at = np.concatenate([[-np.inf], np.sort(at), [np.inf]])
        after = np.searchsorted(at, u)
        seen |= np.minimum(u - at[after - 1], at[after] - u) <= 0.75 * frame_pitch_mm + 1e-9
    return seen


def _rounded(values: Float) -> list[Any]:
    """As nested lists at 1e-9, null for NaN."""
    if values.ndim == 2:
        return [[round(float(x), 9) for x in row] for row in values]
    return [None if np.isnan(x) else round(float(x), 9) for x in values]
