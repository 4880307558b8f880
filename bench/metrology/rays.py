"""What each ray of a simulated scan really met: the face, where, and at which incidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Recording
from workbench.geometry.poses import inverse
from workbench.synthetic import Recipe, raycast
from workbench.synthetic.scan import column_offsets, plan_motion, sensor_of
from workbench.synthetic.workpiece import build_surface, clamp_boxes, pose
from workbench.units import AnyArray, Bool, Float

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
