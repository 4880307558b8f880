"""Parts of the fourth simulator: `bench.simulators.triangulated`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from bench.drawn.seeds import generator, nominal
from bench.score.errors import about_robot, digit, robot
from bench.score.parts import Drawn
from bench.simulators.triangulated import STRAIGHT_MM, Course, Sensor, Way, Workpiece, simulate
from workbench.units import DEG

Generator = np.random.Generator
ODD = ("burr all along", "rounded by 0.3 to 0.8 mm", "noise over 6 columns", "linearity of 5 um rms", "half of it lost")


def course(rng: Generator, mean: float, change: float, wave: float) -> Course:
    return Course(
        mean, rng.uniform(-change, change), rng.uniform(0.0, wave), rng.uniform(60.0, 200.0), rng.uniform(0, 6)
    )


def workpiece(rng: Generator, kind: str, seed: int) -> Workpiece:
    """With sharp edges: straight, one in two, or an arc."""
    root, height = rng.uniform(1.0, 3.0), rng.uniform(3.0, 7.0)
    bend = STRAIGHT_MM if rng.random() < 0.5 else float(rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(5.0, 7.5)))
    return Workpiece(
        kind,
        length_mm=rng.uniform(70.0, 120.0),
        radius_mm=bend,
        thickness_mm=root + height,
        root_mm=course(rng, root, 0.15, 0.1),
        bevel=course(rng, rng.uniform(28.0, 52.0) * DEG, 1.0 * DEG, 0.5 * DEG),
        lean=course(rng, rng.uniform(-3.0, 3.0) * DEG, 1.5 * DEG, 0.0),
        gap_mm=course(rng, rng.uniform(1.0, 3.0), 0.4, 0.1),
        table_mm=None if rng.random() < 0.5 else rng.uniform(5.0, 30.0),
        seed=seed,
    )


def sensor(rng: Generator, width_mm: float) -> Sensor:
    return Sensor(
        columns=int(rng.choice([640, 800, 1024])),
        width_mm=width_mm,
        stand_off_mm=rng.uniform(80.0, 200.0),
        triangulation=float(rng.choice([-1.0, 1.0])) * rng.uniform(22.0, 40.0) * DEG,
        side_mm=rng.uniform(-10.0, 10.0),
        footprint=rng.uniform(0.8, 1.6),
        noise_mm=rng.uniform(0.003, 0.012),
        speckle_columns=rng.uniform(0.7, 2.0),
        lobe=rng.uniform(0.25, 0.5),
        shine=rng.uniform(0.2, 0.7),
        threshold=rng.uniform(0.05, 0.2),
        bright=bool(rng.random() < 0.5),
        falls=bool(rng.random() < 0.5),
    )


def way(rng: Generator, part: Workpiece, elevation_deg: float) -> tuple[Way, float]:
    """A way that sees the edge near the middle of the view, and how wide the view must be, mm."""
    lean = elevation_deg * DEG
    back = math.tan(part.bevel.mean) * (part.thickness_mm - part.root_mm.mean)
    middle = (0.0, part.thickness_mm / 2.0) if part.kind == "raw" else (-0.5 * back, 0.6 * part.thickness_mm)
    middle = (0.0, 0.6 * part.thickness_mm) if part.kind == "groove" else middle
    wide = back * math.sin(lean) + part.thickness_mm * math.cos(lean) + rng.uniform(6.0, 12.0)
    wide = 2.0 * back + part.gap_mm.mean + rng.uniform(8.0, 14.0) if part.kind == "groove" else wide
    return Way(
        step_mm=float(rng.choice([0.3, 0.5, 0.7])),
        elevation=lean,
        oblique=tuple((rng.uniform(-4.0, 4.0, 3) * DEG).tolist()),  # type: ignore[arg-type]
        sway=float(rng.choice([0.0, rng.uniform(0.0, 1.5) * DEG])),
        aim_mm=middle,
        drift_mm=rng.uniform(-2.0, 2.0),
        backwards=bool(rng.random() < 0.5),
        robot_mm=0.005,
        robot_deg=0.001,
    ), wide


def made(part: Workpiece, eye: Sensor, led: Way, seed: int, known: dict[str, Any], about: str) -> Drawn:
    drawn = simulate(part, eye, [led], seed)
    while not drawn.truth["seen"].any():  # as an operator would
        eye = replace(eye, threshold=0.7 * eye.threshold)
        drawn = simulate(part, eye, [led], seed)
    declared: dict[str, Any] = {"kind": part.kind}
    if part.kind == "milled":
        declared = nominal(part.root_mm.mean, part.bevel.mean / DEG)
    if part.kind == "raw" or led.elevation < 10.0 * DEG:  # from below
        declared["upper_side"] = drawn.truth["across"][len(drawn.truth["across"]) // 2].tolist()
    shape = "straight" if part.radius_mm == STRAIGHT_MM else f"radius {part.radius_mm:.0f} mm"
    return Drawn(drawn.recording, drawn.truth, declared | known, f"{shape}, {led.elevation / DEG:.0f} deg{about}")


def ordinary(rng: Generator, kind: str, seed: int, low_deg: float, high_deg: float) -> tuple[Workpiece, Sensor, Way]:
    part = workpiece(rng, kind, seed)
    led, wide = way(rng, part, float(rng.uniform(low_deg, high_deg)))
    return part, sensor(rng, wide), led


def real(
    rng: Generator, kind: str, seed: int, elevation_deg: tuple[float, float], robot_mm: tuple[float, float]
) -> tuple[Workpiece, Sensor, Way, dict[str, Any]]:
    """The same by a sensor with an error of linearity and a robot that errs as a process; what data sheets say."""
    part, eye, led = ordinary(rng, kind, seed, *elevation_deg)
    strength, length = robot(rng, *robot_mm)
    slow = rng.uniform(8.0, 40.0)
    sheet = {"linearity_mm": 0.001, "linearity_length_mm": digit(0.5 * slow), "columns": eye.columns}
    known = {"sensor": sheet, "robot_noise_mm": digit(strength), "robot_noise_length_mm": digit(length)}
    eye = replace(eye, linearity_mm=0.001, linearity_length_mm=slow)
    return part, eye, replace(led, robot_mm=strength, robot_length_mm=length), known


def sharp(seed: int) -> Drawn:
    rng = generator("score triangulated sharp", seed)
    return made(*ordinary(rng, "milled", seed, 35.0, 55.0), seed, {}, "")


def worn(seed: int) -> Drawn:
    rng = generator("score triangulated worn", seed)
    part, eye, led, known = real(rng, "milled", seed, (20.0, 50.0), (0.005, 0.03))
    radius, burr = float(rng.uniform(0.01, 0.3)), 0.0
    if seed % 3 == 0:
        radius, burr = 0.0, float(rng.uniform(0.05, 0.3))
    part = replace(part, lower_radius_mm=radius, upper_radius_mm=radius / 3.0, burr_mm=burr)
    about = f", rounded {radius:.3f} mm, burr {burr:.2f} mm, {about_robot(known)}"
    return made(part, eye, led, seed, known, about)


def below(seed: int) -> Drawn:
    rng = generator("score triangulated below", seed)
    part, eye, led, known = real(rng, "milled", seed, (-20.0, 5.0), (0.005, 0.03))
    part = replace(part, lower_radius_mm=float(rng.uniform(0.01, 0.3)), table_mm=None)  # a table would hide the edge
    return made(part, eye, led, seed, known, f", rounded {part.lower_radius_mm:.3f} mm, {about_robot(known)}")


def odd(seed: int) -> Drawn:
    """Every kind in turn."""
    rng = generator("score triangulated odd", seed)
    part, eye, led = ordinary(rng, "milled", seed, 25.0, 55.0)
    what = ODD[seed % len(ODD)]
    if what == ODD[0]:
        part = replace(part, burr_mm=0.6, burr_width_mm=0.4)
    if what == ODD[1]:
        part = replace(part, lower_radius_mm=float(rng.uniform(0.3, 0.8)))
    eye = replace(
        eye,
        speckle_columns=6.0 if what == ODD[2] else eye.speckle_columns,
        linearity_mm=0.005 if what == ODD[3] else 0.0,
        lost=0.5 if what == ODD[4] else eye.lost,
    )
    return made(part, eye, led, seed, {}, f", {what}")


def raw(seed: int) -> Drawn:
    rng = generator("score triangulated raw", seed)
    part, eye, led, known = real(rng, "raw", seed, (20.0, 50.0), (0.01, 0.06))
    part = replace(part, lower_radius_mm=float(rng.choice([0.0, rng.uniform(0.02, 0.15)])))
    return made(part, eye, led, seed, known, f", {about_robot(known)}")


def groove(seed: int) -> Drawn:
    rng = generator("score triangulated groove", seed)
    part, eye, led = ordinary(rng, "groove", seed, 85.0, 95.0)
    return made(part, eye, led, seed, {}, "")


DRAWS = {"sharp": sharp, "worn": worn, "below": below, "odd": odd, "raw": raw, "groove": groove}
