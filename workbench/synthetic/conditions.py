"""Random parts under named conditions, for statistics over many of them: nothing is chosen to be easy to measure."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable

import numpy as np

from workbench.errors import InputError, nearest
from workbench.synthetic.draws import (
    Document,
    Generator,
    aim_at,
    bevel_end_mm,
    draw_course,
    draw_disturbances,
    draw_part,
    draw_pass,
    draw_robot,
    draw_scanner,
)
from workbench.synthetic.recipe import Recipe
from workbench.synthetic.recipe_file import parse_recipe
from workbench.units import DEG


def random_recipe(condition: str, seed: int) -> Recipe:
    """A recipe drawn at random under `condition` (a key of CONDITIONS); the same seed gives the same recipe.

    Unless the condition says otherwise: a straight milled edge of 80 to 160 mm anywhere in the base, root 0.8 to
    3 mm, bevel 30 to 50 deg, both drifting, thickness 5 to 12 mm, noise 0.012 mm, pitch 0.05 mm, 0.5 % outliers.
    """
    if condition not in CONDITIONS:
        raise InputError(f"condition '{condition}'", "a named condition" + nearest(condition, CONDITIONS))
    rng = np.random.default_rng([seed, zlib.crc32(condition.encode())])
    document: Document = {
        "title": condition,
        "seed": seed,
        "part": draw_part(rng),
        "scanner": draw_scanner(rng),
        "disturbances": draw_disturbances(rng),
        "robot": draw_robot(rng),
    }
    document["passes"] = [draw_pass(rng, document)]
    CONDITIONS[condition](rng, document)
    return parse_recipe(document, source=condition)


def _follow_edge(rng: Generator, document: Document) -> None:
    """A dense pose stream along the curve; such poses come from encoders, so they are quiet."""
    stopping = rng.random() < 0.1
    for scan in document["passes"]:
        scan.update(motion="stop_and_go" if stopping else "stream", follow="edge")
    document["robot"].update(pose_noise_mm=rng.uniform(0, 0.01), pose_noise_deg=rng.uniform(0, 0.001))


def _as_is(rng: Generator, document: Document) -> None:
    pass


def _paper(rng: Generator, document: Document) -> None:
    document["part"].update(
        root_mm=draw_course(rng, 1.5 + rng.uniform(-0.3, 0.3), 0.2, 0.1),
        bevel_deg=draw_course(rng, 40 + rng.uniform(-0.7, 0.7), 0.2, 0.1),
        end_face_tilt_deg=0.0,
    )


def _arc(rng: Generator, document: Document) -> None:
    radius = math.exp(rng.uniform(math.log(300), math.log(3000)))
    sense = "convex" if rng.random() < 0.5 else "concave"
    document["part"]["curve"] = {"shape": "arc", "radius_mm": radius, "sense": sense}
    _follow_edge(rng, document)


def _wavy(rng: Generator, document: Document) -> None:
    document["part"]["curve"] = {
        "shape": "wavy",
        "amplitude_mm": rng.uniform(1.5, 3),
        "wavelength_mm": rng.uniform(120, 300),
        "phase_deg": rng.uniform(0, 360),
    }
    if rng.random() < 0.5:
        _follow_edge(rng, document)


def _oblique(rng: Generator, document: Document) -> None:
    document["passes"][0]["oblique_deg"] = float(rng.choice([-1, 1])) * rng.uniform(8, 15)


def _two_pass(rng: Generator, document: Document) -> None:
    document["part"]["table_gap_mm"] = None
    second = draw_pass(rng, document, (-60, -20) if rng.random() < 0.7 else (20, 70))
    if second["elevation_deg"] < 0:
        second["aim_mm"] = aim_at(rng.uniform(-3, 3), second["elevation_deg"])
    document["passes"].append(second)


def _reversed(rng: Generator, document: Document) -> None:
    document["scanner"].update(x_rises=False, z_away=False)


def _partial_view(rng: Generator, document: Document) -> None:
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


def _outliers(rng: Generator, document: Document) -> None:
    document["disturbances"].update(outlier_share=0.035, streak_outlier_share=0.015)


def _missing(rng: Generator, document: Document) -> None:
    document["disturbances"].update(dropout_share=0.12, streak_dropout_share=0.08)


def _coarse(rng: Generator, document: Document) -> None:
    document["scanner"].update(pitch_mm=0.1, columns=400)
    document["robot"]["frame_pitch_mm"] = rng.uniform(0.5, 1.0)


def _noisy(rng: Generator, document: Document) -> None:
    document["scanner"]["noise"]["sd_mm"] = 0.036


def _correlated(rng: Generator, document: Document) -> None:
    document["scanner"]["noise"].update(sd_mm=0.036, correlation_columns=rng.uniform(2, 8))


def _robot_error(rng: Generator, document: Document) -> None:
    document["robot"]["smooth_error_mm"] = 0.1
    if rng.random() < 0.5:
        _follow_edge(rng, document)


def _clamps(rng: Generator, document: Document) -> None:
    length, clamps = document["part"]["length_mm"], []
    for _ in range(rng.integers(1, 4)):
        start = rng.uniform(5, length - 30)
        clamps.append({"from_mm": start, "to_mm": start + rng.uniform(8, 25), "height_mm": rng.uniform(3, 20)})
    document["part"]["clamps"] = clamps


def _vibration(rng: Generator, document: Document) -> None:
    document["robot"]["vibration_mm"] = 0.05


def _limit(rng: Generator, document: Document) -> None:
    """One characteristic within 0.03 mm or 0.15 deg of a limit of +-0.5 mm or +-1 deg, the other well inside."""
    _paper(rng, document)
    side = float(rng.choice([-1, 1]))
    if rng.random() < 0.5:
        document["part"]["root_mm"] = draw_course(rng, 1.5 + side * (0.5 + rng.uniform(-0.03, 0.03)), 0.01, 0.005)
    else:
        document["part"]["bevel_deg"] = draw_course(rng, 40 + side * (1 + rng.uniform(-0.15, 0.15)), 0.05, 0.02)


CONDITIONS: dict[str, Callable[[Generator, Document], None]] = {
    "paper": _paper,
    "straight": _as_is,
    "arc": _arc,
    "wavy": _wavy,
    "oblique": _oblique,
    "two_pass": _two_pass,
    "reversed": _reversed,
    "partial_view": _partial_view,
    "outliers_5": _outliers,
    "missing_20": _missing,
    "coarse": _coarse,
    "noisy": _noisy,
    "correlated": _correlated,
    "robot_error": _robot_error,
    "clamps": _clamps,
    "vibration": _vibration,
    "limit": _limit,
}
