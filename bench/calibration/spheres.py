"""Samples of scanned spheres: a turntable that carries two, and a tool that touches two with a ball of its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from workbench.api import DEG, Float, quaternion_from_rotation, rotation_from_vector

AXIS = np.array([0.02, -0.03, 1.0]) / np.linalg.norm([0.02, -0.03, 1.0])
ON_AXIS_MM = np.array([1500.0, 200.0, 400.0])
BALLS_MM = {"near": np.array([150.0, -120.0, 90.0]), "far": np.array([-170.0, 60.0, 30.0])}  # on the table, turned by 0
ANGLES_DEG = (0, 60, 140)
EACH = 4  # postures of a sphere at a place
TIP_MM = np.array([80.0, -20.0, 250.0])  # middle of the tool's ball, on the flange
REFERENCES_MM = {"ball 0": np.array([1200.0, 100.0, 600.0]), "ball 1": np.array([1300.0, -200.0, 650.0])}
STAND_OFF_MM = 8.0  # radius of a sphere, 5 mm, and that of the tool's ball
TOUCHES = 24
NOISE_MM, NOISE_DEG = 0.05, 0.01
LEAN = 0.4  # rad, one axis: how far touches lie off the line to the flange


def write_examples(folder: Path) -> None:
    """Recipes and tables of both, in `folder`; `workbench simulate` makes the recordings."""
    rng = np.random.default_rng(3)
    turned = {
        (name, angle): ON_AXIS_MM + rotation_from_vector(angle * DEG * AXIS[None])[0] @ ball
        for name, ball in BALLS_MM.items()
        for angle in ANGLES_DEG
    }
    title = "Two 10 mm spheres on a turntable at three angles, four postures each"
    _write_recipe(folder / "sphere_turntable.json", title, list(turned.values()), rng)
    rows = [f"{name},{angle},{EACH * k + i}" for k, (name, angle) in enumerate(turned) for i in range(EACH)]
    _write_table(folder / "sphere_turntable.csv", "marker,angle_deg,pass", rows)

    title = "Two 10 mm spheres that a tool touches, four postures each"
    _write_recipe(folder / "sphere_tool.json", title, list(REFERENCES_MM.values()), rng)
    rows = [f"{name},{EACH * k + i}" for k, name in enumerate(REFERENCES_MM) for i in range(EACH)]
    _write_table(folder / "sphere_tool.csv", "reference,pass", rows)
    head = "reference,tool_point,x_mm,y_mm,z_mm,qw,qx,qy,qz,stand_off_mm"
    _write_table(folder / "sphere_touches.csv", head, _touches(rng))


def _write_table(path: Path, head: str, rows: list[str]) -> None:
    path.write_text("\n".join(["# simulated: bench.calibration.spheres", head, *rows]) + "\n", encoding="utf-8")


def _write_recipe(path: Path, title: str, places: list[Float], rng: np.random.Generator) -> None:
    passes = [
        {
            "sphere_mm": [*rng.uniform(-9, 9, 1).round(1), (-1) ** i * rng.uniform(2, 4), rng.uniform(-13, 13)],
            "turn_deg": rng.uniform(-22, 22, 3).round(0).tolist(),
            "center_mm": place.round(3).tolist(),
        }
        for place in places
        for i in range(EACH)
    ]
    for one in passes:
        one["sphere_mm"] = [round(float(v), 1) for v in one["sphere_mm"]]
    document = {
        "format": "sphere-recipe",
        "version": 1,
        "title": title,
        "seed": int(rng.integers(1000)),
        "sphere": {"stem_diameter_mm": 4, "table_gap_mm": 14},
        "scanner": {"columns": 640, "near_mm": 115, "far_mm": 195, "noise": {"sd_mm": 0.015}},
        "robot": {"design_error_mm": 5, "design_error_deg": 2, "pose_noise_mm": NOISE_MM, "pose_noise_deg": NOISE_DEG},
        "passes": passes,
    }
    lines = json.dumps(document, indent=2).split('"passes": [')[0]
    path.write_text(
        lines + '"passes": [\n    ' + ",\n    ".join(json.dumps(one) for one in passes) + "\n  ]\n}\n", encoding="utf-8"
    )


def _touches(rng: np.random.Generator) -> list[str]:
    """The tool presses from its side, 0 to 40 deg off its own line."""
    rows = []
    for i, turn in enumerate(rotation_from_vector(0.5 * rng.normal(size=(TOUCHES, 3)))):
        name, reference = list(REFERENCES_MM.items())[i % 2]
        lever = turn @ TIP_MM
        way = rotation_from_vector(LEAN * rng.normal(size=(1, 3)))[0] @ (-lever / np.linalg.norm(lever))
        at = reference + STAND_OFF_MM * way - lever + rng.normal(size=3) * NOISE_MM
        at = at - np.cross(rng.normal(size=3) * NOISE_DEG * DEG, lever)
        told = [*(f"{v:.3f}" for v in at), *(f"{v:.7f}" for v in quaternion_from_rotation(turn))]
        rows.append(f"{name},tip,{','.join(told)},{STAND_OFF_MM:g}")
    return rows
