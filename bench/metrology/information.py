"""What rays of a simulated scan really met, and what each frame tells of its faces and of the root face's lower end.

In the section plane a point has the coordinates g, along the root face's outward normal, and v, along the root face
from the lower edge. The bevel face starts at v = R, the root face, and leans back by the bevel angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Recording
from workbench.geometry.poses import inverse
from workbench.kernels import kernel
from workbench.synthetic import Recipe, raycast
from workbench.synthetic.scan import column_offsets, plan_motion, sensor_of
from workbench.synthetic.workpiece import build_surface, clamp_boxes, pose
from workbench.units import AnyArray, Bool, Float, Int

OUTLIER_SIGMAS = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Exact rays of N frames and M columns, before noise, outliers and dropouts."""

    faces: AnyArray  # (N, M) uint8, `raycast.ROOT`, ...; NOTHING: no return
    x_mm: Float  # (N, M) profiler frame
    z_mm: Float  # (N, M)
    part_from_profiler: Float  # (N, 4, 4) true
    sigma_mm: Float  # (N, M) range noise across the face met: along its normal
    slope: Float  # (M,) lateral way of each ray per mm of range


def exact_rays(recipe: Recipe) -> Rays:
    """Cast every ray of the recipe's scan again, without what disturbs its return."""
    surface, sensor = build_surface(recipe.part, recipe.seed), sensor_of(recipe.scanner)
    boxes, offsets = clamp_boxes(recipe.part, surface), column_offsets(recipe.scanner)
    table = -np.inf if recipe.part.table_gap_mm is None else -recipe.part.table_gap_mm
    base_from_profiler = np.concatenate([motion.base_from_profiler for motion in plan_motion(recipe)])
    part_from_profiler = inverse(pose(recipe.part.base_from_part)) @ base_from_profiler
    ranges, faces, cosines, _ = raycast.cast(surface, boxes, table, sensor, part_from_profiler, offsets)
    slope = sensor.sign * offsets if sensor.angular else np.zeros(len(offsets))
    lateral = ranges * offsets if sensor.angular else np.broadcast_to(offsets, ranges.shape)
    sigma = range_sigma_mm(recipe, cosines) * cosines * np.hypot(1.0, slope)
    return Rays(
        faces, sensor.emitter_x + lateral, sensor.emitter_z + sensor.sign * ranges, part_from_profiler, sigma, slope
    )


def range_sigma_mm(recipe: Recipe, cosines: Float) -> Float:
    """Standard deviation of the range: the recipe's noise, greater at grazing incidence, and its quantisation."""
    noise = recipe.scanner.noise
    grazing = np.maximum(cosines, 1e-6) ** -noise.grazing_power
    return np.hypot(noise.sd_mm * np.minimum(grazing, noise.grazing_cap), recipe.scanner.quantum_mm / 12**0.5)


def informative(recipe: Recipe, rays: Rays, recording: Recording) -> Bool:
    """Returns (N, M) that tell of the face that their ray met: neither lost nor outliers."""
    noise = recipe.scanner.noise
    with np.errstate(invalid="ignore"):
        off = np.abs(recording.z_mm - rays.z_mm)
        return np.asarray(off < OUTLIER_SIGMAS * noise.sd_mm * noise.grazing_cap)


COUNT, OFFSET, CENTRE, SLOPE, ALONG = range(5)  # columns of `Frames.root` and the like
LOWEST, STEP, LEAN = range(3)  # columns of `Frames.ends`


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """N frames, a row each. A face's row: how many points; information on its offset along its normal (1/mm^2); mean
    coordinate along the face, weighted (mm); information on its direction (1/rad^2); mean u (mm). Zeros: not seen.
    """

    root: Float  # (N, 5)
    bevel: Float  # (N, 5), counted from the corner with the root face
    lower: Float  # (N, 5)
    ends: Float  # (N, 3) v of the lowest return on the root face, step to the next column, dv/dg of its ray; NaN: none
    pass_index: Int  # (N,)


def frame_information(recipe: Recipe, rays: Rays, good: Bool, pass_index: Int) -> Frames:
    """Fisher information of each frame, whose own shift is unknown, from the informative returns `good` (N, M)."""
    surface, columns = build_surface(recipe.part, recipe.seed), recipe.scanner.noise.correlation_columns
    keep = math.exp(-1.0 / columns) if columns > 0 else 0.0
    grid = (rays.faces, rays.x_mm, rays.z_mm, rays.part_from_profiler)
    sums = _sums(surface, *grid, rays.sigma_mm, good, keep)
    return Frames(sums[:, 0], sums[:, 1], sums[:, 2], _ends(surface, *grid, rays.slope, good), pass_index)


@kernel
def _in_section(s: raycast.Surface, pose: Float, x: float, z: float) -> tuple[float, float, float]:
    """u, g and v of a point of the profiler's plane."""
    px = pose[0, 0] * x + pose[0, 2] * z + pose[0, 3]
    py = pose[1, 0] * x + pose[1, 2] * z + pose[1, 3]
    pz = pose[2, 0] * x + pose[2, 2] * z + pose[2, 3]
    u, h, _, _, _ = raycast.project(s, px, py)
    return u, h * s.tilt_cos - pz * s.tilt_sin, pz * s.tilt_cos + h * s.tilt_sin


@kernel
def _along(s: raycast.Surface, face: int, u: float, g: float, v: float) -> float:
    """Coordinate along a face: from the lower edge, or on the bevel from the corner."""
    if face == raycast.ROOT:
        return v
    if face == raycast.BEVEL:
        bevel = raycast.course(s.bevel, u)[0]
        return (v - raycast.course(s.root, u)[0]) * math.cos(bevel) - g * math.sin(bevel)
    return g


@kernel
def _sums(
    s: raycast.Surface,
    met: AnyArray,
    x: Float,
    z: Float,
    part_from_profiler: Float,
    sigma: Float,
    good: Bool,
    keep: float,
) -> Float:
    """Rows (N, 3, 5) of root face, bevel face, lower surface. `keep`: correlation of neighbouring columns' noise."""
    out = np.zeros((met.shape[0], 3, 5))
    for i in range(met.shape[0]):
        for f, face in enumerate((raycast.ROOT, raycast.BEVEL, raycast.LOWER)):
            last, before, before_along = -1, 0.0, 0.0
            count, total, i00, i01, i11 = 0.0, 0.0, 0.0, 0.0, 0.0
            for j in range(met.shape[1]):
                if met[i, j] != face or not good[i, j]:
                    continue
                u, g, v = _in_section(s, part_from_profiler[i], x[i, j], z[i, j])
                one = 1.0 / sigma[i, j]
                along = one * _along(s, face, u, g, v)
                w0, w1 = one, along
                if last >= 0 and keep > 0.0:  # white innovations of first-order autoregressive noise
                    r = keep ** (j - last)
                    fresh = math.sqrt(1.0 - r * r)
                    w0, w1 = (one - r * before) / fresh, (along - r * before_along) / fresh
                last, before, before_along = j, one, along
                count, total = count + 1.0, total + u
                i00, i01, i11 = i00 + w0 * w0, i01 + w0 * w1, i11 + w1 * w1
            if count > 1.0:
                out[i, f] = count, i00, i01 / i00, i11 - i01 * i01 / i00, total / count
    return out


@kernel
def _ends(
    s: raycast.Surface, met: AnyArray, x: Float, z: Float, part_from_profiler: Float, slope: Float, good: Bool
) -> Float:
    """The lowest return (N, 3) on the root face; NaN where it is lost or an outlier."""
    out = np.full((met.shape[0], 3), np.nan)
    for i in range(met.shape[0]):
        pose = part_from_profiler[i]
        lowest, next_lowest, column = np.inf, np.inf, -1
        for j in range(met.shape[1]):
            if met[i, j] != raycast.ROOT:
                continue
            _, _, v = _in_section(s, pose, x[i, j], z[i, j])
            if v < lowest:
                lowest, next_lowest, column = v, lowest, j
            elif v < next_lowest:
                next_lowest = v
        if column >= 0 and good[i, column] and next_lowest < np.inf:
            _, g0, v0 = _in_section(s, pose, x[i, column], z[i, column])
            _, g1, v1 = _in_section(s, pose, x[i, column] + slope[column], z[i, column] + 1.0)
            out[i] = lowest, next_lowest - lowest, (v1 - v0) / (g1 - g0)
    return out
