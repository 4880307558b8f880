"""Parts whose scans are planned: drawn at random, scanned as planned, by two simulators that share no code."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.simulators.triangulated import Course, Sensor, Way, Workpiece
from bench.simulators.triangulated import simulate as triangulate
from workbench.artefacts import PlannedScan, Recording
from workbench.scan_plan import ScanPlan
from workbench.scan_plan.information import decay_columns
from workbench.scan_plan.search import Wanted
from workbench.scan_plan.way import aim_mm
from workbench.synthetic import Recipe, parse_recipe
from workbench.synthetic import Workpiece as Milled
from workbench.synthetic.simulate import scan_workpiece
from workbench.units import DEG

LENGTH_MM, STANDOFF_MM, ROBOT_MM = 100.0, 150.0, 0.01
LINEARITY_MM, LINEARITY_LENGTH_MM = 0.001, 10.0
SPECKLE_COLUMNS = 1.0  # standard deviation of the Gaussian that makes 0.8 of the triangulated noise from white noise
NOISE_COLUMNS = 0.64 * 2.0 * math.sqrt(math.pi) * SPECKLE_COLUMNS + 0.36  # the sum of its correlations


class Drawn(NamedTuple):
    """What is known of a part before its scan, and what is not."""

    recipe: Recipe  # of the part as it is, for the analytic simulator
    sensor: dict[str, Any]  # its file
    wanted: Wanted
    root_mm: float
    thickness_mm: float
    bevel_deg: float
    radius_mm: float  # of the lower edge; the analytic simulator's are sharp


def draw(seed: int) -> Drawn:
    """A part from straight to twisted, some with a clamp or a table below it, its sensor, and what is wanted."""
    rng = np.random.default_rng([74, seed])
    root = float(rng.uniform(1.2, 3.0))
    thickness, bevel = root + float(rng.uniform(4.0, 9.0)), float(rng.uniform(28.0, 48.0))
    width, columns = float(rng.uniform(24.0, 34.0)), int(rng.choice([640, 800, 1024, 1280]))
    noise = float(rng.uniform(0.004, 0.014))
    clamps = []
    if rng.random() < 0.5:
        first = float(rng.uniform(15.0, 60.0))
        clamp = {"from_mm": first, "to_mm": first + float(rng.uniform(10.0, 25.0))}
        clamps = [clamp | {"reach_in_mm": 40.0, "reach_out_mm": float(rng.uniform(2.0, 10.0)), "height_mm": 12.0}]
    curve = {"shape": "arc", "radius_mm": 800} if rng.random() < 0.5 else {"shape": "straight"}
    document = {
        "format": "bevel-recipe",
        "version": 1,
        "seed": seed,
        "part": {
            "kind": "milled",
            "length_mm": LENGTH_MM,
            "curve": curve,
            "thickness_mm": thickness,
            "root_mm": {"start": root, "end": root, "amplitude": float(rng.choice([0.0, 0.05])), "wavelength_mm": 90},
            "bevel_deg": bevel,
            "end_face_twist_deg": float(rng.choice([0.0, rng.uniform(-4.0, 4.0)])),
            "table_gap_mm": float(rng.uniform(60.0, 100.0)) if rng.random() < 0.3 else None,
            "clamps": clamps,
            "base_from_part": {"position_mm": [1450.0, -320.0, 760.0], "rpy_deg": [35, 2.5, -1.5]},
        },
        "scanner": {"columns": columns, "pitch_mm": width / columns, "standoff_mm": STANDOFF_MM},
        "robot": {"pose_noise_mm": ROBOT_MM, "pose_noise_deg": 0.001},
        "disturbances": {"dropout_share": 0.003, "outlier_share": 0.002},
        "passes": [{"from_mm": 0, "to_mm": LENGTH_MM}],
    }
    sensor = {
        "columns": columns,
        "measuring_range_mm": [STANDOFF_MM - 35.0, STANDOFF_MM + 35.0],
        "width_mm": [width, width],
        "noise_mm": noise,
        "noise_columns": NOISE_COLUMNS,
        "linearity_mm": LINEARITY_MM,
        "linearity_length_mm": 0.5 * LINEARITY_LENGTH_MM,
        "camera_side": "y",
        "triangulation_deg": 25,
        "body": [{"centre_mm": [0, 35, -40], "size_mm": [60, 130, 80]}],
    }
    wanted = Wanted(float(rng.choice([0.01, 0.02, 0.05, 0.1])), float(rng.choice([0.08, 0.12, 0.2])))
    radius = float(rng.choice([0.0, rng.uniform(0.01, 0.3)]))
    return Drawn(parse_recipe(document, f"part {seed}"), sensor, wanted, root, thickness, bevel, radius)


def sensor_file(drawn: Drawn, folder: Path) -> Path:
    """As the plan and the engine read it."""
    file = folder / "sensor.json"
    file.write_text(json.dumps(drawn.sensor))
    return file


def analytic(drawn: Drawn, made: ScanPlan, way: PlannedScan) -> tuple[Recording, Any]:
    """By `workbench.synthetic`, along the planned poses: a sharp edge, clamps, twist, no speckle."""
    scanner = drawn.recipe.scanner.model_copy(
        update={
            "near_mm": made.profiler.range_mm[0],
            "far_mm": made.profiler.range_mm[1],
            "baseline_mm": way.camera_mm,
            "noise": drawn.recipe.scanner.noise.model_copy(
                update={"sd_mm": made.profiler.noise_mm, "correlation_columns": decay_columns(NOISE_COLUMNS)}
            ),
        }
    )
    part = Milled(drawn.recipe.model_copy(update={"scanner": scanner}))
    recording, truth = scan_workpiece(part, way.courses)
    return recording, {name: getattr(truth, name) for name in ("position_mm", "seen", "root_mm", "bevel_deg")}


def triangulated(drawn: Drawn, made: ScanPlan, seed: int) -> tuple[Recording, Any]:
    """By `bench.simulators.triangulated`, in the plan's views: camera beside the laser, footprint, rounding."""
    rng = np.random.default_rng([75, seed])
    course = drawn.recipe.part.root_mm
    part = Workpiece(
        "milled",
        LENGTH_MM,
        float(np.exp(rng.uniform(6.0, 9.0))),
        drawn.thickness_mm,
        Course(drawn.root_mm, 0.0, course.amplitude, course.wavelength_mm),
        Course(drawn.bevel_deg * DEG),
        lower_radius_mm=drawn.radius_mm,
        upper_radius_mm=drawn.radius_mm / 3.0,
        table_mm=drawn.recipe.part.table_gap_mm,
        seed=seed,
    )
    sensor = Sensor(
        columns=made.profiler.columns,
        width_mm=made.profiler.width_mm[0],
        stand_off_mm=STANDOFF_MM,
        noise_mm=made.profiler.noise_mm,
        speckle_columns=SPECKLE_COLUMNS,
        linearity_mm=LINEARITY_MM,
        linearity_length_mm=LINEARITY_LENGTH_MM,
        threshold=0.08,
        bright=False,
    )
    ways = [
        Way(
            step_mm=one.view.frame_pitch_mm,
            elevation=one.view.elevation,
            aim_mm=tuple(aim_mm(made.joint, one.view).tolist()),
            drift_mm=one.drift_mm,
            robot_mm=ROBOT_MM,
            robot_deg=0.001,
        )
        for one in made.passes
    ]
    return triangulate(part, sensor, ways, seed)
