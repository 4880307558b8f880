"""What random recipes of the swept simulator share: where a part lies, how it runs, by what it is seen.

The order in which values are drawn belongs to it: a seed gives the part that it gave.
"""

from __future__ import annotations

from bench.drawn.declared import Document, Generator
from bench.drawn.plates import draw_course


def course(rng: Generator, mean: float, drift: float, wave: float) -> Document:
    """As `draw_course`; no wave is shorter than 60 mm."""
    return draw_course(rng, mean, drift, wave, shortest_mm=60)


def anywhere(rng: Generator, pitch_deg: float, yaw_deg: float) -> Document:
    """A part's pose before the robot, leaning and turned by up to so much."""
    return {
        "position_mm": [rng.uniform(800, 1800), rng.uniform(-800, 800), rng.uniform(300, 1200)],
        "rpy_deg": [rng.uniform(-180, 180), rng.uniform(-pitch_deg, pitch_deg), rng.uniform(-yaw_deg, yaw_deg)],
    }


def spine(rng: Generator, length_mm: float, height_mm: float = 0.0) -> Document:
    """A straight spine, one in two, an arc or a wavy one, which goes up and down by up to `height_mm`."""
    shape = str(rng.choice(["straight", "straight", "arc", "wavy"]))
    drawn: Document = {"shape": shape, "length_mm": length_mm}
    if shape == "arc":
        drawn |= {"radius_mm": rng.uniform(150, 1500), "sense": str(rng.choice(["convex", "concave"]))}
    if shape == "wavy":
        drawn["amplitude_mm"] = rng.uniform(0.3, 2)
        if height_mm > 0.0:
            drawn["height_amplitude_mm"] = rng.uniform(0, height_mm)
        drawn["wavelength_mm"] = rng.uniform(120, 300)
    return drawn


def scanner(
    rng: Generator, standoff_mm: float, range_mm: tuple[float, float], apex_mm: tuple[float, float] = (10, 100)
) -> Document:
    """A scanner that measures within `range_mm` of its stand-off, by parallel rays or by a fan from an apex."""
    return {
        "apex_mm": None if rng.random() < 0.3 else rng.uniform(*apex_mm),
        "x_rises": bool(rng.random() < 0.5),
        "z_away": bool(rng.random() < 0.8),
        "zero_range_mm": float(rng.choice([0.0, standoff_mm])),
        "standoff_mm": standoff_mm,
        "near_mm": standoff_mm + range_mm[0],
        "far_mm": standoff_mm + range_mm[1],
        "baseline_mm": float(rng.choice([-1, 1])) * rng.uniform(30, 80),
    }


def noise(rng: Generator, sd_mm: float, correlation: float = 0.0) -> Document:
    """Its noise: of half of the scanners that have a correlation, neighbouring columns share up to so much of it."""
    drawn: Document = {"sd_mm": sd_mm, "grazing_power": rng.uniform(0, 1), "speckle": rng.uniform(0.1, 0.3)}
    if correlation > 0.0:
        drawn["column_correlation"] = float(rng.choice([0, rng.uniform(0, correlation)]))
    return drawn


def robot(rng: Generator) -> Document:
    """The noise of its poses."""
    return {"pose_noise_mm": rng.uniform(0, 0.02), "pose_noise_deg": rng.uniform(0, 0.003)}


def way(rng: Generator, length_mm: float) -> list[float]:
    """From 2 mm behind one end of a groove or plate to the other, in either sense."""
    return [2.0, length_mm - 2.0] if rng.random() < 0.5 else [length_mm - 2.0, 2.0]


def held(rng: Generator, along: Document) -> Document:
    """How the scanner is held on its way along a spine."""
    straight = along.get("shape", "straight") == "straight"
    return {
        "oblique_deg": rng.uniform(-4, 4),
        "lead_deg": rng.uniform(-6, 6),
        "upside_down": bool(rng.random() < 0.5),
        "follow": "line" if straight else "edge",
    }
