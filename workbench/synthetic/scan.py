"""The scan: every frame of every pass, from the robot's motion to x and z as returned, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from workbench.geometry.poses import inverse
from workbench.synthetic import raycast
from workbench.synthetic.motion import PassMotion, generator, move
from workbench.synthetic.recipe import Recipe, Scanner
from workbench.synthetic.returns import disturb, intensities
from workbench.synthetic.surface import build_surface, clamp_boxes, pose
from workbench.synthetic.workpiece import Cut
from workbench.units import AnyArray, Float, Float32, Shaped

BLOCK_FRAMES = 256
_PAUSE_S = 2.0  # between passes


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Some frames of one pass, as returned."""

    x_mm: Shaped[Float32, "B M"]
    z_mm: Shaped[Float32, "B M"]
    intensity: Shaped[AnyArray, "B M"] | None  # uint16
    faces: Shaped[AnyArray, "B M"]  # uint8, the true face of each ray (`raycast.ROOT`, ...)
    seen_u: Float  # where those frames that see the edge cross it


def plan_motion(recipe: Recipe, cut: Cut | None = None) -> list[PassMotion]:
    """The motion of every pass, one after the other in time, past the part less what was cut."""
    surface, motions, start = build_surface(recipe.part, recipe.seed), [], 1.0
    for index in range(len(recipe.passes)):
        motions.append(move(recipe, surface, index, start, _repeat(cut)))
        start = float(max(motions[-1].time_s[-1], motions[-1].pose_time_s[-1])) + _PAUSE_S
    return motions


def scan_pass(recipe: Recipe, motion: PassMotion, index: int, cut: Cut | None = None) -> Iterator[tuple[int, Block]]:
    """The frames of pass `index` block by block: first frame, block. Random numbers are drawn per block."""
    surface = build_surface(recipe.part, recipe.seed, cut)
    boxes, sensor = clamp_boxes(recipe.part, surface), sensor_of(recipe.scanner)
    table = -np.inf if recipe.part.table_gap_mm is None else -recipe.part.table_gap_mm
    offsets = column_offsets(recipe.scanner)
    profiler_from = inverse(pose(recipe.part.base_from_part))
    for number, first in enumerate(range(0, len(motion.time_s), BLOCK_FRAMES)):
        part_from_profiler = profiler_from @ motion.base_from_profiler[first : first + BLOCK_FRAMES]
        exact, faces, cosines, sight = raycast.cast(surface, boxes, table, sensor, part_from_profiler, offsets)
        rng = generator(recipe, 3, index, number, repeat=_repeat(cut))
        ranges = disturb(recipe, exact, cosines, rng)
        x, z = _coordinates(sensor, ranges, offsets)
        seen = (sight[:, 0] >= 2) & (sight[:, 2] < 0.4 * recipe.part.root_mm.lowest)
        if surface.milled or cut is not None:
            seen &= sight[:, 1] >= 2
        grey = intensities(ranges, cosines, rng) if recipe.scanner.intensity else None
        yield first, Block(x, z, grey, faces, sight[seen, 3])


def _repeat(cut: Cut | None) -> int:
    return 0 if cut is None else cut.times


def sensor_of(scanner: Scanner) -> raycast.Sensor:
    """The scanner as the kernels see it."""
    sign = 1.0 if scanner.z_away else -1.0
    return raycast.Sensor(
        sign=sign,
        emitter_x=scanner.x_offset_mm,
        emitter_z=-sign * scanner.zero_range_mm,
        baseline=scanner.baseline_mm,
        near=scanner.near_mm,
        far=scanner.far_mm,
        fan=scanner.beam == "fan" or scanner.sampling == "angular",
        angular=scanner.sampling == "angular",
        cos_min=float(np.cos(np.radians(scanner.max_incidence_deg))),
    )


def column_offsets(scanner: Scanner) -> Float:
    """Lateral position of each column from the emitter (mm), or the tangent of its angle, `pitch_mm` at standoff."""
    offsets = (np.arange(scanner.columns) - (scanner.columns - 1) / 2) * scanner.pitch_mm
    if not scanner.x_rises:
        offsets = -offsets
    return np.asarray(np.tan(offsets / scanner.standoff_mm) if scanner.sampling == "angular" else offsets)


def _coordinates(sensor: raycast.Sensor, ranges: Float, offsets: Float) -> tuple[Float32, Float32]:
    """x and z in the profiler frame, mm."""
    z = sensor.emitter_z + sensor.sign * ranges
    lateral = ranges * offsets if sensor.angular else np.broadcast_to(offsets, ranges.shape)
    return (sensor.emitter_x + lateral).astype(np.float32), z.astype(np.float32)
