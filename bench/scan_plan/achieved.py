"""One part scanned as a plan would have it, and what the engine makes of it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from bench.simulators.triangulated import Course, Sensor, Way, Workpiece
from bench.simulators.triangulated import simulate as triangulate
from workbench import cloud, edge, scan
from workbench.artefacts import Recording
from workbench.edge.residual_image import Linearity
from workbench.scan_plan.information import Joint, Knowledge, Profiler, View, combined, hidden_why, information
from workbench.scan_plan.way import drift_mm
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.units import DEG, Float

LENGTH_MM, RANGE_MM = 80.0, 150.0
LINEARITY_MM, LINEARITY_LENGTH_MM = 0.001, 10.0


class Drawn(NamedTuple):
    """What a plan knows of a part: nominal joint, sensor, prior; and how it is scanned."""

    joint: Joint
    profiler: Profiler
    known: Knowledge
    views: tuple[View, ...]
    wave_mm: float  # of root face, amplitude
    table_mm: float | None


class Compared(NamedTuple):
    """Of one part: predicted standard uncertainties, and at stations the engine's and the errors (k,)."""

    root_u_mm: float
    bevel_u_deg: float
    achieved_root_u_mm: Float
    achieved_bevel_u_deg: Float
    root_error_mm: Float
    bevel_error_deg: Float


def draw(seed: int, elevations_deg: tuple[float, float] = (-35.0, 50.0), most_passes: int = 2) -> Drawn:
    """A part, a sensor, and one or two passes that it allows."""
    rng = np.random.default_rng([71, seed])
    while True:
        root = rng.uniform(1.2, 3.0)
        joint = Joint(root + rng.uniform(4.0, 9.0), root, rng.uniform(28.0, 48.0) * DEG)
        columns, width = int(rng.choice([640, 800, 1024, 1280])), rng.uniform(22.0, 34.0)
        radius = float(rng.choice([0.0, rng.uniform(0.01, 0.2)]))
        profiler = Profiler(
            columns,
            (RANGE_MM - 30.0, RANGE_MM + 40.0),
            (width, width),
            rng.uniform(0.004, 0.014),
            1.0,
            Linearity(LINEARITY_MM, LINEARITY_LENGTH_MM),
        )
        pitch = float(rng.choice([0.2, 0.3, 0.5]))
        views = tuple(
            View(float(rng.uniform(*elevations_deg)) * DEG, RANGE_MM, pitch)
            for _ in range(int(rng.integers(1, most_passes + 1)))
        )
        table = float(rng.uniform(60.0, 100.0)) if rng.random() < 0.3 else None
        drift = max(drift_mm(profiler, view) for view in views)
        if not any(hidden_why(joint, profiler, view, drift) for view in views):
            known = Knowledge(0.01, 0.0, "unknown", radius)
            return Drawn(joint, profiler, known, views, float(rng.choice([0.0, rng.uniform(0.0, 0.05)])), table)


def analytic(drawn: Drawn, seed: int) -> tuple[Recording, Any]:
    """By `workbench.synthetic`: a sharp edge, no speckle."""
    joint, profiler = drawn.joint, drawn.profiler
    rng = np.random.default_rng([72, seed])
    middle = 0.5 * (joint.section_mm.min(axis=0) + joint.section_mm.max(axis=0))
    passes = []
    for view in drawn.views:
        drift = drift_mm(profiler, view)
        passes.append(
            {
                "from_mm": 2.0,
                "to_mm": LENGTH_MM - 2.0,
                "elevation_deg": view.elevation / DEG,
                "lead_deg": view.lead / DEG,
                "aim_mm": middle.tolist(),
                "skew_mm": [-0.5 * drift, 0.5 * drift],
                "motion": "stream",
            }
        )
    document = {
        "format": "bevel-recipe",
        "version": 1,
        "seed": seed,
        "part": {
            "kind": "milled",
            "length_mm": LENGTH_MM,
            "thickness_mm": joint.thickness_mm,
            "root_mm": {
                "start": joint.root_mm,
                "end": joint.root_mm,
                "amplitude": drawn.wave_mm,
                "wavelength_mm": float(rng.uniform(40.0, 150.0)),
            },
            "bevel_deg": {"start": joint.bevel / DEG, "end": joint.bevel / DEG},
            "base_from_part": {"position_mm": [1450.0, -320.0, 760.0], "rpy_deg": [35, 2.5, -1.5]},
        },
        "scanner": {
            "columns": profiler.columns,
            "pitch_mm": profiler.pitch_mm(RANGE_MM),
            "standoff_mm": RANGE_MM,
            "near_mm": profiler.range_mm[0],
            "far_mm": profiler.range_mm[1],
            "noise": {"sd_mm": profiler.noise_mm},
        },
        "robot": {
            "frame_pitch_mm": drawn.views[0].frame_pitch_mm,
            "pose_noise_mm": drawn.known.robot_noise_mm,
            "pose_noise_deg": 0.001,
        },
        "disturbances": {"dropout_share": 0.003, "outlier_share": 0.002},
        "passes": passes,
    }
    recording, truth = simulate_recording(parse_recipe(document, source=f"analytic {seed}"))
    return recording, {name: getattr(truth, name) for name in ("position_mm", "seen", "root_mm", "bevel_deg")}


def triangulated(drawn: Drawn, seed: int) -> tuple[Recording, Any]:
    """By `bench.simulators.triangulated`: camera beside the laser, footprint, rounding, linearity."""
    joint, profiler = drawn.joint, drawn.profiler
    rng = np.random.default_rng([73, seed])
    part = Workpiece(
        "milled",
        LENGTH_MM,
        float(np.exp(rng.uniform(6.0, 9.0))),
        joint.thickness_mm,
        Course(joint.root_mm, 0.0, drawn.wave_mm, float(rng.uniform(60.0, 150.0))),
        Course(joint.bevel),
        lower_radius_mm=drawn.known.radius_mm or 0.0,
        upper_radius_mm=(drawn.known.radius_mm or 0.0) / 3.0,
        table_mm=drawn.table_mm,
        seed=seed,
    )
    sensor = Sensor(
        columns=profiler.columns,
        width_mm=profiler.width_mm[0],
        stand_off_mm=RANGE_MM,
        noise_mm=profiler.noise_mm,
        speckle_columns=1.0,
        linearity_mm=LINEARITY_MM,
        linearity_length_mm=LINEARITY_LENGTH_MM,
        threshold=0.08,
        bright=False,
    )
    middle = 0.5 * (joint.section_mm.min(axis=0) + joint.section_mm.max(axis=0))
    ways = [
        Way(
            step_mm=view.frame_pitch_mm,
            elevation=view.elevation,
            aim_mm=(float(middle[0]), float(middle[1])),
            drift_mm=drift_mm(profiler, view),
            robot_mm=drawn.known.robot_noise_mm,
            robot_deg=0.001,
        )
        for view in drawn.views
    ]
    return triangulate(part, sensor, ways, seed)


SIMULATORS = {"analytic": analytic, "triangulated": triangulated}


def compare(simulator: str, seed: int, drawn: Drawn | None = None) -> Compared:
    """Predict, scan, measure.

    Raises:
        WorkbenchError: the engine refuses the recording.
    """
    drawn = draw(seed) if drawn is None else drawn
    if simulator == "analytic":
        drawn = drawn._replace(known=drawn.known._replace(radius_mm=0.0))
    else:  # its noise is shared by what the footprint and speckle smear
        drawn = drawn._replace(profiler=drawn.profiler)
    length = LENGTH_MM - 4.0
    passes = [information(drawn.joint, drawn.profiler, drawn.known, view, length) for view in drawn.views]
    told = combined(drawn.joint, drawn.known, [one for one in passes if one is not None], length)
    recording, truth = SIMULATORS[simulator](drawn, seed)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "sensor.json"
        file.write_text(json.dumps({"linearity_mm": LINEARITY_MM, "linearity_length_mm": LINEARITY_LENGTH_MM}))
        found = edge.segment(
            cloud.denoise(scan.fuse(recording)),
            root_nominal_mm=drawn.joint.root_mm,
            bevel_nominal_deg=drawn.joint.bevel / DEG,
            robot_noise_mm=drawn.known.robot_noise_mm,
            sensor=file,
        )
    at = np.flatnonzero(found.seen)[3:-3]
    place = found.position_mm[at]
    near = np.argmin(np.linalg.norm(truth["position_mm"][None] - place[:, None], axis=2), axis=1)
    return Compared(
        float(told.root.u),
        float(told.bevel.u),
        found.root.u[at],
        found.bevel.u[at],
        found.root.value[at] - np.asarray(truth["root_mm"])[near],
        found.bevel.value[at] - np.asarray(truth["bevel_deg"])[near],
    )


def ratio(achieved: Float, predicted: float) -> float:
    """Of the root mean square of what was achieved along the part."""
    return math.sqrt(float(np.mean(achieved**2))) / predicted
