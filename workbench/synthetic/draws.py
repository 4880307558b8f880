"""Random parts, scanners, robots and passes as recipe documents: what `conditions` starts from."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np

from workbench.units import DEG

Document: TypeAlias = dict[str, Any]
Generator: TypeAlias = np.random.Generator


def draw_part(rng: Generator) -> Document:
    """A straight milled part, anywhere in the base, on a table or none."""
    thickness = rng.uniform(5, 12)
    root, bevel = rng.uniform(1.08, min(2.72, thickness - 3.0)), rng.uniform(31.0, 49.0)
    return {
        "length_mm": rng.uniform(80, 160),
        "thickness_mm": draw_course(rng, thickness, 0.1, 0.05),
        "root_mm": draw_course(rng, root, 0.25, 0.15),
        "bevel_deg": draw_course(rng, bevel, 1.0, 0.5),
        "end_face_tilt_deg": rng.uniform(-3, 3),
        "table_gap_mm": None if rng.random() < 0.3 else math.exp(rng.uniform(math.log(3), math.log(80))),
        "base_from_part": {
            "position_mm": (_direction(rng) * (1, 1, 0.6) * rng.uniform(1000, 2000)).tolist(),
            "rpy_deg": [rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)],
        },
    }


def draw_course(rng: Generator, mean: float, drift: float, wave: float) -> Document:
    """A value about `mean` that drifts by up to `drift` from end to end, and waves by up to `wave` each way."""
    change = rng.uniform(-drift, drift)
    return {
        "start": mean - change / 2,
        "end": mean + change / 2,
        "amplitude": rng.uniform(0, wave),
        "wavelength_mm": rng.uniform(40, 200),
        "phase_deg": rng.uniform(0, 360),
    }


def _direction(rng: Generator) -> Any:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def draw_scanner(rng: Generator) -> Document:
    """A profiler of 800 columns at 0.05 mm with 0.012 mm of noise, all else as makers differ."""
    standoff = rng.uniform(90, 300)
    return {
        "columns": 800,
        "pitch_mm": 0.05,
        "beam": "fan" if rng.random() < 0.7 else "parallel",
        "sampling": "lateral" if rng.random() < 0.7 else "angular",
        "x_rises": bool(rng.random() < 0.5),
        "z_away": bool(rng.random() < 0.8),
        "zero_range_mm": float(rng.choice([0.0, standoff, rng.uniform(0, 400)])),
        "x_offset_mm": rng.uniform(-10, 10),
        "standoff_mm": standoff,
        "near_mm": standoff - rng.uniform(22, 40),
        "far_mm": standoff + rng.uniform(22, 60),
        "baseline_mm": float(rng.choice([-1, 1])) * rng.uniform(30, 90),
        "max_incidence_deg": rng.uniform(80, 86),
        "noise": {"sd_mm": 0.012, "grazing_power": rng.uniform(0, 1), "grazing_cap": rng.uniform(2, 4)},
        "quantum_mm": float(rng.choice([0.0, 0.001, 0.002])),
    }


def draw_disturbances(rng: Generator) -> Document:
    """0.5 % dropouts and 0.5 % outliers, a third of them in streaks, and mixed pixels."""
    return {
        "dropout_share": 0.005,
        "grazing_dropout": rng.uniform(0, 0.3),
        "outlier_share": 0.0035,
        "streak_outlier_share": 0.0015,
        "outlier_reach_mm": rng.uniform(1, 10),
        "mixed_pixel_probability": rng.uniform(0.2, 0.8),
    }


def draw_robot(rng: Generator) -> Document:
    """A robot whose poses and hand-eye calibration are a little off."""
    return {
        "pose_rate_hz": float(rng.choice([25, 50, 100, 250])),
        "flange_from_profiler": {
            "position_mm": (np.array([126.92, 9.44, 41.48]) + rng.uniform(-30, 30, 3)).tolist(),
            "rpy_deg": (np.array([60.489, -3.813, -2.024]) + rng.uniform(-20, 20, 3)).tolist(),
        },
        "hand_eye_error_mm": rng.uniform(0, 0.1),
        "hand_eye_error_deg": rng.uniform(0, 0.01),
        "pose_noise_mm": rng.uniform(0, 0.05),
        "pose_noise_deg": rng.uniform(0, 0.01),
    }


def draw_pass(rng: Generator, document: Document, elevation_deg: tuple[float, float] = (20, 70)) -> Document:
    """A pass along the whole edge, either way, that sees the edge near the middle of its view."""
    elevation, length = rng.uniform(*elevation_deg), document["part"]["length_mm"]
    lateral = 0.5 * upper_end_mm(document, elevation) + rng.uniform(-4, 4)
    beyond = rng.random(2) < 0.3  # the scan may run over the ends of the plate
    margins = np.where(beyond, rng.uniform(-4, 0, 2), rng.uniform(0.5, 6, 2))
    ends = [margins[0], length - margins[1]]
    skew = rng.uniform(-1.5, 1.5)
    return {
        "from_mm": ends[0],
        "to_mm": ends[1],
        "elevation_deg": elevation,
        "oblique_deg": rng.uniform(-5, 5),
        "lead_deg": rng.uniform(-8, 8),
        "aim_mm": aim_at(lateral, elevation),
        "skew_mm": [-skew, skew],
        "turn_deg": rng.uniform(-1, 1, 3).tolist(),
        "upside_down": bool(rng.random() < 0.5),
    } | ({"from_mm": ends[1], "to_mm": ends[0]} if rng.random() < 0.5 else {})


def upper_end_mm(document: Document, elevation_deg: float) -> float:
    """Lateral distance in the view from the lower edge to the upper edge of the end face, or of the bevel."""
    if document["part"].get("kind") == "raw":
        return float(math.cos(elevation_deg * DEG) * document["part"]["thickness_mm"]["start"])
    return bevel_end_mm(document, elevation_deg)


def bevel_end_mm(document: Document, elevation_deg: float) -> float:
    """Lateral distance in the view from the lower edge to the bevel's upper edge."""
    thickness, root, bevel = (document["part"][name]["start"] for name in ("thickness_mm", "root_mm", "bevel_deg"))
    back = (thickness - root) * math.tan(bevel * DEG)
    return float(math.sin(elevation_deg * DEG) * back + math.cos(elevation_deg * DEG) * thickness)


def aim_at(lateral: float, elevation_deg: float) -> list[float]:
    """The aim point (h, z) that stands `lateral` mm from the lower edge in the view."""
    return [-math.sin(elevation_deg * DEG) * lateral, math.cos(elevation_deg * DEG) * lateral]
