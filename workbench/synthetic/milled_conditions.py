"""Random milled parts under named conditions: each function makes a drawn recipe document what its name says."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from workbench.synthetic.draws import Document, Generator, aim_at, bevel_end_mm, draw_course, draw_pass
from workbench.units import DEG

Condition: TypeAlias = Callable[[Generator, Document], None]


def follow_edge(rng: Generator, document: Document) -> None:
    """A dense pose stream along the curve; such poses come from encoders, so they are quiet."""
    stopping = rng.random() < 0.1
    for scan in document["passes"]:
        scan.update(motion="stop_and_go" if stopping else "stream", follow="edge")
    document["robot"].update(pose_noise_mm=rng.uniform(0, 0.01), pose_noise_deg=rng.uniform(0, 0.001))


def as_is(rng: Generator, document: Document) -> None:
    """Nothing is different."""


def paper(rng: Generator, document: Document) -> None:
    """Within 0.5 mm of 1.5 mm and 1 deg of 40 deg."""
    document["part"].update(
        root_mm=draw_course(rng, 1.5 + rng.uniform(-0.3, 0.3), 0.2, 0.1),
        bevel_deg=draw_course(rng, 40 + rng.uniform(-0.7, 0.7), 0.2, 0.1),
        end_face_tilt_deg=0.0,
    )


def arc(rng: Generator, document: Document) -> None:
    """Radius 300 to 3,000 mm, convex or concave."""
    radius = math.exp(rng.uniform(math.log(300), math.log(3000)))
    sense = "convex" if rng.random() < 0.5 else "concave"
    document["part"]["curve"] = {"shape": "arc", "radius_mm": radius, "sense": sense}
    follow_edge(rng, document)


def wavy(rng: Generator, document: Document) -> None:
    """Amplitude 1.5 to 3 mm."""
    document["part"]["curve"] = {
        "shape": "wavy",
        "amplitude_mm": rng.uniform(1.5, 3),
        "wavelength_mm": rng.uniform(120, 300),
        "phase_deg": rng.uniform(0, 360),
    }
    if rng.random() < 0.5:
        follow_edge(rng, document)


def oblique(rng: Generator, document: Document) -> None:
    """Laser plane 8 to 15 deg out of the section plane."""
    document["passes"][0]["oblique_deg"] = float(rng.choice([-1, 1])) * rng.uniform(8, 15)


def two_pass(rng: Generator, document: Document) -> None:
    """A second pass, mostly from below."""
    document["part"]["table_gap_mm"] = None
    second = draw_pass(rng, document, (-60, -20) if rng.random() < 0.7 else (20, 70))
    if second["elevation_deg"] < 0:
        second["aim_mm"] = aim_at(rng.uniform(-3, 3), second["elevation_deg"])
    document["passes"].append(second)


def reversed(rng: Generator, document: Document) -> None:
    """x falls with the column, z counts towards the sensor."""
    document["scanner"].update(x_rises=False, z_away=False)


def partial_view(rng: Generator, document: Document) -> None:
    """Only end face and bevel: the view grazes both surfaces, or ends on the bevel."""
    if rng.random() < 0.5:
        document["passes"] = [draw_pass(rng, document, (-7, 7))]
        document["passes"][0].update(lead_deg=rng.uniform(-3, 3), turn_deg=[0, 0, 0])
        document["scanner"]["max_incidence_deg"] = 78
        document["scanner"].update(sampling="lateral", beam="parallel")
        return
    scan, part = document["passes"][0], document["part"]
    start = part["root_mm"]["start"] * math.cos(scan["elevation_deg"] * DEG)
    end = bevel_end_mm(document, scan["elevation_deg"])
    half_view = document["scanner"]["columns"] * document["scanner"]["pitch_mm"] / 2
    scan.update(aim_mm=aim_at(start + rng.uniform(0.6, 0.9) * (end - start) - half_view, scan["elevation_deg"]))
    scan.update(skew_mm=[0.0, 0.0], turn_deg=(rng.uniform(-1, 1, 3) * (1, 0, 0)).tolist())


def outliers(rng: Generator, document: Document) -> None:
    """5 % outliers."""
    document["disturbances"].update(outlier_share=0.035, streak_outlier_share=0.015)


def missing(rng: Generator, document: Document) -> None:
    """20 % of the returns missing."""
    document["disturbances"].update(dropout_share=0.12, streak_dropout_share=0.08)


def coarse(rng: Generator, document: Document) -> None:
    """Frames 0.5 to 1 mm apart, columns 0.1 mm."""
    document["scanner"].update(pitch_mm=0.1, columns=400)
    document["robot"]["frame_pitch_mm"] = rng.uniform(0.5, 1.0)


def noisy(rng: Generator, document: Document) -> None:
    """Range noise of 0.036 mm."""
    document["scanner"]["noise"]["sd_mm"] = 0.036


def correlated(rng: Generator, document: Document) -> None:
    """Range noise of 0.036 mm, correlated over 2 to 8 columns."""
    document["scanner"]["noise"].update(sd_mm=0.036, correlation_columns=rng.uniform(2, 8))


def robot_error(rng: Generator, document: Document) -> None:
    """A smooth error of the robot of 0.1 mm an axis."""
    document["robot"]["smooth_error_mm"] = 0.1
    if rng.random() < 0.5:
        follow_edge(rng, document)


def clamps(rng: Generator, document: Document) -> None:
    """One to three clamps."""
    length, clamps = document["part"]["length_mm"], []
    for _ in range(rng.integers(1, 4)):
        start = rng.uniform(5, length - 30)
        clamps.append({"from_mm": start, "to_mm": start + rng.uniform(8, 25), "height_mm": rng.uniform(3, 20)})
    document["part"]["clamps"] = clamps


def vibration(rng: Generator, document: Document) -> None:
    """0.05 mm an axis and frame."""
    document["robot"]["vibration_mm"] = 0.05


def limit(rng: Generator, document: Document) -> None:
    """One characteristic within 0.03 mm or 0.15 deg of a limit of +-0.5 mm or +-1 deg, the other well inside."""
    paper(rng, document)
    side = float(rng.choice([-1, 1]))
    if rng.random() < 0.5:
        document["part"]["root_mm"] = draw_course(rng, 1.5 + side * (0.5 + rng.uniform(-0.03, 0.03)), 0.01, 0.005)
    else:
        document["part"]["bevel_deg"] = draw_course(rng, 40 + side * (1 + rng.uniform(-0.15, 0.15)), 0.05, 0.02)


CONDITIONS: dict[str, Condition] = {
    "paper": paper,
    "straight": as_is,
    "arc": arc,
    "wavy": wavy,
    "oblique": oblique,
    "two_pass": two_pass,
    "reversed": reversed,
    "partial_view": partial_view,
    "outliers_5": outliers,
    "missing_20": missing,
    "coarse": coarse,
    "noisy": noisy,
    "correlated": correlated,
    "robot_error": robot_error,
    "clamps": clamps,
    "vibration": vibration,
    "limit": limit,
}
