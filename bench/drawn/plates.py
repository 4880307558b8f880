"""Random parts under named conditions, for statistics over many of them: nothing is chosen to be easy to measure.

Raw edges are drawn as the milled parts are. Recorded hand-eye and the two poses of a straight motion are exact here,
unless a condition says otherwise: an error of theirs moves the whole edge in the base, no recording shows it, and it
belongs to the mechanics. Poses of a stream are as noisy as on milled parts.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from bench.drawn.declared import Condition, Document, Generator, apply, log_uniform, sign, sometimes, uniform
from bench.drawn.seeds import generator
from workbench.errors import InputError, nearest
from workbench.synthetic.recipe import Recipe
from workbench.synthetic.recipe_file import parse_recipe
from workbench.units import DEG


def begun(
    name: str, seed: int, known: Collection[str], words: str = "", what: str = "condition", one: str = "named condition"
) -> Generator:
    """The random numbers of part `seed` of what has this name; InputError where none has."""
    if name not in known:
        raise InputError(f"{what} '{name}'", f"a {one}{nearest(name, known)}")
    return generator(seed, words + name)


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
            "position_mm": around_the_base(rng),
            "rpy_deg": [rng.uniform(-180, 180), rng.uniform(-90, 90), rng.uniform(-180, 180)],
        },
    }


def draw_course(rng: Generator, mean: float, drift: float, wave: float, shortest_mm: float = 40) -> Document:
    """A value about `mean` that drifts by up to `drift` from end to end, and waves by up to `wave` each way."""
    change = rng.uniform(-drift, drift)
    return {
        "start": mean - change / 2,
        "end": mean + change / 2,
        "amplitude": rng.uniform(0, wave),
        "wavelength_mm": rng.uniform(shortest_mm, 200),
        "phase_deg": rng.uniform(0, 360),
    }


def around_the_base(rng: Generator) -> list[float]:
    """A place 1 to 2 m from the robot's base in any direction, lower above it and below."""
    vector = rng.normal(size=3)
    return list((vector / np.linalg.norm(vector) * (1, 1, 0.6) * rng.uniform(1000, 2000)).tolist())


def draw_hand_eye(rng: Generator) -> Document:
    """The paper's hand-eye pose, off by up to 30 mm and 20 deg an axis."""
    return {
        "position_mm": (np.array([126.92, 9.44, 41.48]) + rng.uniform(-30, 30, 3)).tolist(),
        "rpy_deg": (np.array([60.489, -3.813, -2.024]) + rng.uniform(-20, 20, 3)).tolist(),
    }


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
        "baseline_mm": sign(rng) * rng.uniform(30, 90),
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
        "flange_from_profiler": draw_hand_eye(rng),
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


def follow_edge(rng: Generator, document: Document) -> None:
    """A dense pose stream along the curve; such poses come from encoders, so they are quiet."""
    stopping = rng.random() < 0.1
    for scan in document["passes"]:
        scan.update(motion="stop_and_go" if stopping else "stream", follow="edge")
    document["robot"].update(pose_noise_mm=rng.uniform(0, 0.01), pose_noise_deg=rng.uniform(0, 0.001))


def oblique(rng: Generator, document: Document) -> None:
    """Laser plane 8 to 15 deg out of the section plane."""
    document["passes"][0]["oblique_deg"] = sign(rng) * rng.uniform(8, 15)


def two_pass(rng: Generator, document: Document) -> None:
    """A second pass, mostly from below."""
    document["part"]["table_gap_mm"] = None
    second = draw_pass(rng, document, (-60, -20) if rng.random() < 0.7 else (20, 70))
    if second["elevation_deg"] < 0:
        second["aim_mm"] = aim_at(rng.uniform(-3, 3), second["elevation_deg"])
    document["passes"].append(second)


def partial_view(rng: Generator, document: Document) -> None:
    """Only end face and bevel: the view grazes both surfaces, or ends on the bevel."""
    if rng.random() < 0.5:
        document["passes"] = [draw_pass(rng, document, (-7, 7))]
        document["passes"][0].update(lead_deg=rng.uniform(-3, 3), turn_deg=[0, 0, 0])
        document["scanner"].update(GRAZED)
        return
    scan, part = document["passes"][0], document["part"]
    start = part["root_mm"]["start"] * math.cos(scan["elevation_deg"] * DEG)
    end = bevel_end_mm(document, scan["elevation_deg"])
    half_view = document["scanner"]["columns"] * document["scanner"]["pitch_mm"] / 2
    scan.update(aim_mm=aim_at(start + rng.uniform(0.6, 0.9) * (end - start) - half_view, scan["elevation_deg"]))
    scan.update(skew_mm=[0.0, 0.0], turn_deg=(rng.uniform(-1, 1, 3) * (1, 0, 0)).tolist())


def clamps(rng: Generator, document: Document) -> None:
    """One to three clamps."""
    document["part"]["clamps"] = some_clamps(rng, document["part"]["length_mm"], 25, 20)


def some_clamps(rng: Generator, length_mm: float, widest_mm: float, highest_mm: float) -> list[Document]:
    """One to three along an edge, at least 8 mm wide and 3 mm high."""
    starts = (rng.uniform(5, length_mm - 30) for _ in range(rng.integers(1, 4)))
    return [
        {"from_mm": start, "to_mm": start + rng.uniform(8, widest_mm), "height_mm": rng.uniform(3, highest_mm)}
        for start in starts
    ]


GRAZED = {"max_incidence_deg": 78, "sampling": "lateral", "beam": "parallel"}  # scanners that see no grazed surface
CONDITIONS: dict[str, Condition] = {  # docs/tables/simulation_named_conditions.csv
    "paper": {
        "part": {
            "root_mm": lambda rng: draw_course(rng, 1.5 + rng.uniform(-0.3, 0.3), 0.2, 0.1),
            "bevel_deg": lambda rng: draw_course(rng, 40 + rng.uniform(-0.7, 0.7), 0.2, 0.1),
            "end_face_tilt_deg": 0.0,
        }
    },
    "arc": (
        {
            "part": {
                "curve": {
                    "shape": "arc",
                    "radius_mm": log_uniform(300, 3000),
                    "sense": lambda rng: "convex" if rng.random() < 0.5 else "concave",
                }
            }
        },
        follow_edge,
    ),
    "wavy": (
        {
            "part": {
                "curve": {
                    "shape": "wavy",
                    "amplitude_mm": uniform(1.5, 3),
                    "wavelength_mm": uniform(120, 300),
                    "phase_deg": uniform(0, 360),
                }
            }
        },
        sometimes(0.5, follow_edge),
    ),
    "oblique": oblique,
    "two_pass": two_pass,
    "reversed": {"scanner": {"x_rises": False, "z_away": False}},
    "partial_view": partial_view,
    "coarse": {"scanner": {"pitch_mm": 0.1, "columns": 400}, "robot": {"frame_pitch_mm": uniform(0.5, 1.0)}},
    "noisy": {"scanner": {"noise": {"sd_mm": 0.036}}},
    "correlated": {"scanner": {"noise": {"sd_mm": 0.036, "correlation_columns": uniform(2, 8)}}},
    "robot_error": ({"robot": {"smooth_error_mm": 0.1}}, sometimes(0.5, follow_edge)),
    "clamps": clamps,
    "vibration": {"robot": {"vibration_mm": 0.05}},
    "straight": {},
    "outliers_5": {"disturbances": {"outlier_share": 0.035, "streak_outlier_share": 0.015}},
    "missing_20": {"disturbances": {"dropout_share": 0.12, "streak_dropout_share": 0.08}},
}


def straight(rng: Generator, document: Document) -> None:
    """A raw plate instead of the milled one, its end face near the middle of the view."""
    part = document["part"]
    part.update(kind="raw")
    del part["root_mm"], part["bevel_deg"]
    document["robot"].update(hand_eye_error_mm=0.0, hand_eye_error_deg=0.0)
    _set_passes(document, draw_pass(rng, document))
    if rng.random() < 0.5:
        document["passes"][0].update(motion="stream")
    else:
        document["robot"].update(pose_noise_mm=0.0, pose_noise_deg=0.0)


def _set_passes(document: Document, *passes: Document) -> None:
    """The passes, moving as those that they replace."""
    motion = {key: document["passes"][0][key] for key in ("motion", "follow") if key in document["passes"][0]}
    document["passes"] = [scan | motion for scan in passes]


def drift(rng: Generator, document: Document) -> None:
    """The thickness drifts by 5 % from end to end."""
    mean = rng.uniform(5, 12)
    change = sign(rng) * 0.05 * mean
    course = draw_course(rng, mean, 0.0, 0.05)
    document["part"]["thickness_mm"] = course | {"start": mean - change / 2, "end": mean + change / 2}


def twist(rng: Generator, document: Document) -> None:
    """The end face turns about the edge by up to 30 deg in 150 mm."""
    document["part"]["end_face_twist_deg"] = rng.uniform(-30, 30) * min(1.0, document["part"]["length_mm"] / 150)


def burrs(rng: Generator, document: Document) -> None:
    """One to four of them, at either edge of the end face."""
    length, ridges = document["part"]["length_mm"], []
    for _ in range(rng.integers(1, 5)):
        start = rng.uniform(0, length - 10)
        ridges.append(
            {
                "edge": str(rng.choice(["lower", "upper"])),
                "from_mm": start,
                "to_mm": start + rng.uniform(3, 25),
                "height_mm": rng.uniform(0.1, 0.5),
                "width_mm": rng.uniform(0.2, 0.6),
            }
        )
    document["part"]["burrs"] = ridges


def below(rng: Generator, document: Document) -> None:
    """End face and lower surface in view; no table hides them."""
    document["part"]["table_gap_mm"] = None
    _set_passes(document, draw_pass(rng, document, (-70, -20)))


def two_raw_passes(rng: Generator, document: Document) -> None:
    """From above and from below."""
    document["part"]["table_gap_mm"] = None
    _set_passes(document, document["passes"][0], draw_pass(rng, document, (-70, -20)))


def square(rng: Generator, document: Document) -> None:
    """Only the end face returns: the view grazes both surfaces."""
    scan = draw_pass(rng, document, (-7, 7))
    _set_passes(document, scan | {"lead_deg": rng.uniform(-3, 3), "turn_deg": [0, 0, 0]})
    document["scanner"].update(GRAZED)


_RAW: dict[str, Condition] = {
    name: CONDITIONS[name] for name in ("straight", "arc", "wavy", "outliers_5", "missing_20", "clamps")
} | {
    "drift": drift,
    "rough": {"part": {"roughness_mm": 0.3}},
    "twist": twist,
    "burrs": burrs,
    "below": below,
    "square": square,
    "two_pass": two_raw_passes,
}
RAW_CONDITIONS: dict[str, Condition] = {f"raw_{name}": (straight, condition) for name, condition in _RAW.items()}


def random_recipe(condition: str, seed: int) -> Recipe:
    """A recipe drawn at random under `condition`; the same seed gives the same recipe.

    Unless the condition (a key of CONDITIONS) says otherwise: a straight milled edge of 80 to 160 mm anywhere in the
    base, root 0.8 to 3 mm, bevel 30 to 50 deg, both drifting, thickness 5 to 12 mm, noise 0.012 mm, pitch 0.05 mm,
    0.5 % outliers. Keys of RAW_CONDITIONS draw raw edges in the same way.
    """
    known = CONDITIONS | RAW_CONDITIONS
    rng = begun(condition, seed, known)
    document = draw_plate(rng, seed)
    apply(known[condition], rng, document)
    return parse_recipe(document | {"title": condition}, source=condition)


def draw_plate(rng: Generator, seed: int, elevation_deg: tuple[float, float] = (20, 70)) -> Document:
    """A recipe's document of a milled part under no condition, with one pass."""
    document: Document = {
        "seed": seed,
        "part": draw_part(rng),
        "scanner": draw_scanner(rng),
        "disturbances": draw_disturbances(rng),
        "robot": draw_robot(rng),
    }
    return document | {"passes": [draw_pass(rng, document, elevation_deg)]}
