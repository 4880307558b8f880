"""From a recipe's part to the analytic surface that rays meet, and the section frames along its lower edge."""

from __future__ import annotations

import math

import numpy as np

from workbench.geometry.poses import pose_from, rotation_from_rpy
from workbench.synthetic import raycast
from workbench.synthetic.recipe import Course, Part, Placement
from workbench.synthetic.workpiece import Cut
from workbench.units import DEG, Float

_BENDS = {"straight": raycast.STRAIGHT, "arc": raycast.ARC, "wavy": raycast.WAVY}
_ROUGHNESS_WAVES = 16


def build_surface(part: Part, seed: int = 0, cut: Cut | None = None) -> raycast.Surface:
    """The part's surface, less what was cut. `seed` draws the roughness; all else follows from the recipe."""
    curve, length = part.curve, part.length_mm
    bend = 1.0 / curve.radius_mm if curve.shape == "arc" else 0.0
    rough = _roughness(part.roughness_mm, np.random.default_rng([seed, 0x50A]))
    burrs = np.array(
        [[float(b.edge == "upper"), b.from_mm, b.to_mm, b.height_mm, b.width_mm] for b in part.burrs]
    ).reshape(-1, 5)
    twist = part.end_face_twist_deg * DEG / length
    tilt = part.end_face_tilt_deg * DEG - 0.5 * twist * length
    return raycast.Surface(
        bend=_BENDS[curve.shape],
        curvature=bend if curve.sense == "convex" else -bend,
        wave_amplitude=curve.amplitude_mm,
        wave_number=2 * math.pi / curve.wavelength_mm,
        wave_phase=curve.phase_deg * DEG,
        length=length,
        width=part.plate_width_mm,
        tilt=tilt,
        tilt_cos=math.cos(tilt),
        tilt_sin=math.sin(tilt),
        twist=twist,
        milled=part.kind == "milled",
        thickness=_course(part.thickness_mm, length),
        root=_course(part.root_mm, length),
        bevel=_course(part.bevel_deg, length, DEG),
        roughness=rough,
        rough_reach=float(np.sum(rough[:, 0])),
        burrs=burrs,
        top=part.thickness_mm.highest + sum(b.height_mm for b in part.burrs),
        relax=_safe_step(rough, burrs, abs(twist) * (part.thickness_mm.highest + raycast.OUTREACH_MM)),
        reserve=float(2 * np.sum(rough[:, 0]) + np.sum(burrs[:, 3])),
        cut=raycast.UNCUT if cut is None else cut.terms(twist),
    )


def clamp_boxes(part: Part, surface: raycast.Surface) -> Float:
    """The clamps as boxes (c, 10) for `raycast.enter_box`: each lies along its stretch's chord."""
    boxes = np.empty((len(part.clamps), 10))
    for box, clamp in zip(boxes, part.clamps, strict=True):
        ends, middle = edge_frames(surface, np.array([clamp.from_mm, clamp.to_mm])), 0.5 * (clamp.from_mm + clamp.to_mm)
        centre = edge_frames(surface, np.array([middle]))[0]
        along = (ends[:, :3, 3] - centre[:3, 3]) @ centre[:3, 1]
        box[:4] = *centre[:2, 3], *centre[:2, 1]
        box[4:] = *along, -clamp.reach_in_mm, clamp.reach_out_mm, -2.0, surface.top + clamp.height_mm
    return boxes


def edge_frames(surface: raycast.Surface, u: Float) -> Float:
    """part_from_edge (n, 4, 4) at u: origin on the lower edge; x outwards (horizontal), y along t, z up."""
    frames = np.zeros((len(u), 4, 4))
    x, y, tx, ty = raycast.edge_points(surface, np.array(u, dtype=float)).T
    frames[:, 0, 0], frames[:, 1, 0] = ty, -tx
    frames[:, 0, 1], frames[:, 1, 1] = tx, ty
    frames[:, 2, 2] = frames[:, 3, 3] = 1.0
    frames[:, 0, 3], frames[:, 1, 3] = x, y
    return frames


def end_face_axes(surface: raycast.Surface, u: Float, outward: Float, up: Float) -> tuple[Float, Float]:
    """n and m (n, 3) at u (n,): the end face's outward normal, and the direction across it from the lower edge."""
    tilt = (surface.tilt + surface.twist * u)[:, None]
    return np.cos(tilt) * outward - np.sin(tilt) * up, np.cos(tilt) * up + np.sin(tilt) * outward


def arc_length(surface: raycast.Surface, u: Float) -> Float:
    """Arc length (mm) of the lower edge from the part's start to u (ascending); u itself unless the edge is wavy."""
    if surface.bend != raycast.WAVY:
        return np.array(u, dtype=float)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    steps = np.diff(u, prepend=0.0)
    at = (u - steps)[:, None] + steps[:, None] * (nodes + 1) / 2
    steep = surface.wave_amplitude * surface.wave_number * np.cos(surface.wave_number * at + surface.wave_phase)
    return np.asarray(np.cumsum(np.sqrt(1 + steep**2) @ weights * steps / 2))


def course_values(course: raycast.CourseTerms, u: Float) -> Float:
    """A course's values at u (n,)."""
    return np.asarray(course[0] + course[1] * u + course[2] * np.sin(course[3] * u + course[4]), dtype=float)


def pose(placement: Placement) -> Float:
    """The 4x4 matrix of a placement: R = Rz(roll) Ry(pitch) Rx(yaw) (section 3 of the paper)."""
    return pose_from(rotation_from_rpy(*(angle * DEG for angle in placement.rpy_deg)), np.array(placement.position_mm))


def _course(course: Course, length: float, unit: float = 1.0) -> raycast.CourseTerms:
    slope, wave_number = (course.end - course.start) / length, 2 * math.pi / course.wavelength_mm
    return course.start * unit, slope * unit, course.amplitude * unit, wave_number, course.phase_deg * DEG


def _roughness(greatest: float, rng: np.random.Generator) -> Float:
    """Random waves of 0.7 to 20 mm, the shorter the lower, with a standard deviation of a third of `greatest`."""
    if greatest == 0.0:
        return np.zeros((0, 4))
    wavelength = np.exp(rng.uniform(math.log(0.7), math.log(20.0), _ROUGHNESS_WAVES))
    direction = rng.uniform(0, math.pi, _ROUGHNESS_WAVES)
    amplitude = np.sqrt(wavelength) / np.linalg.norm(np.sqrt(wavelength)) * math.sqrt(2) * greatest / 3
    wave = 2 * math.pi / wavelength
    phase = rng.uniform(0, 2 * math.pi, _ROUGHNESS_WAVES)
    return np.stack([amplitude, wave * np.cos(direction), wave * np.sin(direction), phase], axis=1)


def _safe_step(rough: Float, burrs: Float, turning: float) -> float:
    """1 / (a bound on |grad F|), so that a step of that share of F never jumps through a wall; 0 for a smooth part."""
    if len(rough) + len(burrs) == 0:
        return 0.0
    steepest = 2.0 * math.sqrt(np.sum((rough[:, 0] * np.hypot(rough[:, 1], rough[:, 2])) ** 2))
    if len(burrs):
        along = np.pi * burrs[:, 3] / (burrs[:, 2] - burrs[:, 1])
        steepest += np.max(np.hypot(0.86 * burrs[:, 3] / burrs[:, 4], along))
    steepest += turning
    return float(1.0 / math.hypot(1.05, steepest))
