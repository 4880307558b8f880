"""Random swept parts under named conditions, for statistics over many of them."""

from __future__ import annotations

import math

from bench.drawn.common import anywhere, course, held, noise, robot, scanner
from bench.drawn.declared import Condition, Document, Generator, apply, either, log_uniform, sign, uniform
from bench.drawn.plates import aim_at, begun, some_clamps, upper_end_mm
from bench.simulators.swept.recipe import SweptRecipe


def random_swept_recipe(condition: str, seed: int) -> SweptRecipe:
    """A recipe drawn at random under `condition`, a key of SWEPT_CONDITIONS or RAW_SWEPT_CONDITIONS.

    Unless the condition says otherwise: a straight edge of 100 to 140 mm anywhere in the base, root 0.8 to 3 mm, bevel
    30 to 50 deg, both drifting, 600 columns of 0.05 mm, frames 0.4 mm apart, range noise 0.012 mm, speckle, footprints
    of half a column to one, mixed pixels, 0.3 % outliers, 0.5 % lost returns, poses with noise of up to 0.02 mm.
    """
    known = SWEPT_CONDITIONS | RAW_SWEPT_CONDITIONS
    rng = begun(condition, seed, known, "swept ")
    document = _document(rng, condition, seed, raw=condition in RAW_SWEPT_CONDITIONS)
    apply(known[condition], rng, document)
    _look(rng, document)
    return SweptRecipe.model_validate(document)


def _document(rng: Generator, condition: str, seed: int, raw: bool) -> Document:
    thickness = rng.uniform(5, 12)
    part: Document = {
        "kind": "raw" if raw else "milled",
        "spine": {"length_mm": rng.uniform(100, 140)},
        "thickness_mm": course(rng, thickness, 0.1, 0.05),
        "base_from_part": anywhere(rng, 90, 180),
    }
    if not raw:
        part["root_mm"] = course(rng, rng.uniform(1.08, min(2.72, thickness - 3)), 0.25, 0.15)
        part["bevel_deg"] = course(rng, rng.uniform(31, 49), 1.0, 0.5)
    standoff = rng.uniform(90, 250)
    return {
        "simulator": "swept",
        "title": condition,
        "seed": seed,
        "part": part,
        "scanner": scanner(rng, standoff, (-30, 40))
        | {
            "footprint": rng.uniform(0.5, 1),
            "mixed_share": rng.uniform(0.2, 0.8),
            "noise": noise(rng, 0.012),
            "intensity": bool(rng.random() < 0.5),
        },
        "losses": {"single_share": 0.005, "outlier_share": 0.003, "outlier_reach_mm": rng.uniform(1, 8)},
        "robot": robot(rng),
        "way": {},  # what a condition asks of the passes
    }


def _look(rng: Generator, document: Document) -> None:
    """Passes along the whole edge that see it near the middle of the view, as `way` asks."""
    asked, part = document.pop("way"), document["part"]
    length = part["spine"]["length_mm"]
    closed = asked.pop("closed", False)
    low, high = (-2.0, length + 2.0) if closed else (rng.uniform(0.5, 4), length - rng.uniform(0.5, 4))
    places = asked.pop("places", [0.0, 1.0])  # shares of the way from low to high
    way = [low + share * (high - low) for share in places]
    count = asked.pop("passes", 1)
    skew = asked.pop("skew", rng.uniform(-1.5, 1.5))
    passes = []
    for number in range(count):
        elevation = rng.uniform(25, 65)
        there = [low + high - s for s in way] if rng.random() < 0.5 or number % 2 else way
        lateral = 0.5 * upper_end_mm(document, elevation) + rng.uniform(-2, 2)
        passes.append(
            {
                "way_mm": there,
                "elevation_deg": elevation,
                "aim_mm": aim_at(lateral, elevation),
                "skew_mm": [-skew, skew],
                "motion": "stream",
            }
            | held(rng, part["spine"])
            | asked
        )
    document["passes"] = passes


def rounded(rng: Generator, document: Document) -> None:
    """Lower edge rounded by up to 0.5 mm, the other edges by up to half of that."""
    radius = rng.uniform(0, 0.5)
    document["part"].update(
        lower_radius_mm=radius,
        middle_radius_mm=radius * rng.uniform(0, 0.5),
        upper_radius_mm=radius * rng.uniform(0, 0.5),
    )


def lost_edge(rng: Generator, document: Document) -> None:
    """The last one to eight columns of the root face lost over a fifth to a half of the edge."""
    length = document["part"]["spine"]["length_mm"]
    start, part = rng.uniform(0, 0.5) * length, rng.uniform(0.2, 0.5) * length
    document["losses"].update(edge_columns=int(rng.integers(1, 9)), edge_from_mm=start, edge_to_mm=start + part)


def burr_out(rng: Generator, document: Document) -> None:
    """One to three burrs that stand out of the root face, or at its upper edge."""
    _burrs(rng, document, "out_of_plane", 0.4)


def burr_in(rng: Generator, document: Document) -> None:
    """One to three burrs of up to 0.3 mm that prolong the root face at its lower edge."""
    _burrs(rng, document, "in_plane", 0.3)


def _burrs(rng: Generator, document: Document, direction: str, height: float) -> None:
    length, burrs = document["part"]["spine"]["length_mm"], []
    for _ in range(rng.integers(1, 4)):
        start = rng.uniform(2, length - 25)
        edge = "upper" if direction == "out_of_plane" and rng.random() < 0.3 else "lower"
        burrs.append(
            {
                "edge": edge,
                "direction": direction,
                "from_mm": start,
                "to_mm": start + rng.uniform(3, 20),
                "height_mm": rng.uniform(0.1, height),
                "width_mm": rng.uniform(0.1, 0.4),
                "ragged": rng.uniform(0.2, 0.8),
            }
        )
    document["part"]["burrs"] = burrs


def twist(rng: Generator, document: Document) -> None:
    """The section turns by up to 30 deg over 150 mm."""
    turn = sign(rng) * rng.uniform(0, 30) * document["part"]["spine"]["length_mm"] / 150
    document["part"]["twist_deg"] = {"start": -turn / 2, "end": turn / 2}
    document["way"]["follow"] = "section" if abs(turn) > 12 or rng.random() < 0.5 else "edge"


def saddle(rng: Generator, document: Document) -> None:
    """A part of a nozzle's cut-out: nozzle 60 to 200 mm in a shell of 2 to 6 times that."""
    radius = log_uniform(60, 200)(rng)
    document["part"]["spine"].update(
        shape="saddle",
        radius_mm=radius,
        shell_radius_mm=radius * log_uniform(2, 6)(rng),
        start_deg=rng.uniform(0, 360),
    )


def ring(rng: Generator, document: Document) -> None:
    """350 to 360 deg of a disc or a hole, radius 30 to 60 mm."""
    radius, full = rng.uniform(30, 60), bool(rng.random() < 0.4)
    turn = 2 * math.pi if full else math.radians(rng.uniform(350, 359.5))
    document["part"]["spine"].update(
        shape="arc", radius_mm=radius, length_mm=turn * radius, sense=str(rng.choice(["convex", "concave"]))
    )
    document["part"]["reach_mm"] = 0.6 * radius
    for name in ("thickness_mm", "root_mm", "bevel_deg"):
        if name in document["part"]:  # the same at the end of the turn as at its start
            course = document["part"][name]
            middle = (course["start"] + course["end"]) / 2
            course.update(start=middle, end=middle, wavelength_mm=2 * math.pi * radius / rng.integers(1, 4))
    document["way"]["closed"] = full


def wavy_root(rng: Generator, document: Document) -> None:
    """The root face waves by up to 0.05 mm over 15 to 60 mm, at a slope of up to 1 deg."""
    wavelength = log_uniform(15, 60)(rng)
    amplitude = min(rng.uniform(0, 0.05), math.radians(1.0) * wavelength / (2 * math.pi))
    document["part"]["wave_mm"] = {
        "start": 0,
        "end": 0,
        "amplitude": amplitude,
        "wavelength_mm": wavelength,
        "phase_deg": rng.uniform(0, 360),
    }


def bowed(rng: Generator, document: Document) -> None:
    """Bevel bowed by up to 0.1 mm, root face by up to 0.05 mm, one of them or both."""
    which = rng.integers(1, 4)
    document["part"].update(
        bevel_bow_mm=sign(rng) * rng.uniform(0, 0.1) if which & 1 else 0.0,
        root_bow_mm=sign(rng) * rng.uniform(0, 0.05) if which & 2 else 0.0,
    )


def ghosts(rng: Generator, document: Document) -> None:
    """Second returns 0.05 to 0.3 mm off on a part of a face, everywhere or along a part of the edge."""
    length = document["part"]["spine"]["length_mm"]
    start = rng.uniform(0, 0.4)
    everywhere = rng.random() < 0.5
    low = rng.uniform(0, 0.6)
    document["part"]["ghosts"] = [
        {
            "face": "root" if document["part"]["kind"] == "raw" or rng.random() < 0.2 else "bevel",
            "from_mm": -10.0 if everywhere else start * length,
            "to_mm": 1e4 if everywhere else (start + rng.uniform(0.1, 0.5)) * length,
            "across": [low, low + rng.uniform(0.15, 0.4)],
            "offset_mm": sign(rng) * rng.uniform(0.05, 0.3),
            "probability": 1.0 if rng.random() < 0.5 else rng.uniform(0.3, 1),
        }
    ]


def one_phase(rng: Generator, document: Document) -> None:
    """The motion runs parallel to the edge within half a column in 20 mm; no brightness."""
    columns = rng.uniform(-0.5, 0.5) * document["part"]["spine"]["length_mm"] / 20
    document["way"].update(skew=columns * 0.05 / 2, oblique_deg=0.0, lead_deg=0.0)
    document["robot"].update(pose_noise_mm=0.0, pose_noise_deg=0.0)
    document["scanner"]["intensity"] = False


def there_and_back(rng: Generator, document: Document) -> None:
    """There and back in one pass, or the second half as a second pass."""
    document["way"].update({"places": [0.0, 1.0, 0.0]} if rng.random() < 0.5 else {"passes": 2})


def reversal(rng: Generator, document: Document) -> None:
    """It turns back by 10 to 30 mm once within the pass."""
    length = document["part"]["spine"]["length_mm"]
    stop = rng.uniform(0.4, 0.8)
    document["way"]["places"] = [0.0, stop, stop - rng.uniform(10, 30) / length, 1.0]


def clamps(rng: Generator, document: Document) -> None:
    """One to three clamps."""
    document["part"]["clamps"] = some_clamps(rng, document["part"]["spine"]["length_mm"], 20, 15)


def mixed(rng: Generator, document: Document) -> None:
    """Two to four of the faults at random, one of the shapes often among them."""
    faults = list(FAULTS)
    if document["part"]["kind"] == "raw":
        faults = [*(name for name in FAULTS if name != "wavy_root"), "rough"]
    chosen = [faults[i] for i in rng.choice(len(faults), rng.integers(2, 5), replace=False)]
    if rng.random() < 0.6:
        chosen.insert(0, list(SHAPES)[rng.integers(len(SHAPES))])
    if "rough" in chosen and "bowed" in chosen:
        chosen.remove("bowed")
    document["title"] = "mixed: " + ", ".join(chosen)
    for name in chosen:
        apply(EVERY[name], rng, document)


SHAPES: dict[str, Condition] = {
    "arc": {
        "part": {
            "spine": {"shape": "arc", "radius_mm": log_uniform(100, 3000), "sense": either("convex", "concave")},
        }
    },
    "space_wave": {  # in the plate's plane and out of it
        "part": {
            "spine": {
                "shape": "wavy",
                "amplitude_mm": uniform(0.5, 3),
                "height_amplitude_mm": uniform(0, 2),
                "wavelength_mm": uniform(120, 300),
                "phase_deg": uniform(0, 360),
            }
        }
    },
    "twist": twist,
    "saddle": saddle,
}
HELIX = {
    "shape": "arc",
    "radius_mm": log_uniform(100, 500),
    "rise_mm": uniform(-80, 80),
    "sense": either("convex", "concave"),
}
CORRELATED: Condition = {"scanner": {"noise": {"sd_mm": uniform(0.012, 0.036), "column_correlation": 0.8}}}
SWAY: Condition = {
    "way": {"sway_deg": lambda rng: rng.uniform(-3, 3, 3).tolist(), "sway_wavelength_mm": uniform(30, 120)}
}
FAULTS: dict[str, Condition] = {
    "texture": {"part": {"texture": {"sd_mm": uniform(0, 0.01), "correlation_mm": log_uniform(0.1, 0.8)}}},
    "rounded": rounded,
    "lost_blocks": {"losses": {"block_share": uniform(0.1, 0.25), "block_columns": [5, 40], "block_frames": [3, 30]}},
    "lost_edge": lost_edge,
    "burr_out": burr_out,
    "burr_in": burr_in,
    "wavy_root": wavy_root,
    "bowed": bowed,
    "ghosts": ghosts,
    "correlated": CORRELATED,
    "fixed_pattern": (CORRELATED, {"scanner": {"noise": {"pattern_share": uniform(0.2, 0.5)}}}),
    "sway": SWAY,
    "reversal": reversal,
    "there_and_back": there_and_back,
    "drift": {
        "robot": {
            "drift_mm": uniform(0, 0.1),
            "smooth_error_mm": uniform(0, 0.05),
            "smooth_error_wavelength_mm": uniform(60, 250),
        }
    },
    "clamps": clamps,
}
OTHERS: dict[str, Condition] = {
    "plain": {},
    "two_poses": {  # the paper's case: the two ends of a straight motion, hand-eye and poses as good as robots are
        "way": {"motion": "two_poses", "follow": "line"},
        "robot": {
            "pose_noise_mm": uniform(0, 0.05),
            "pose_noise_deg": uniform(0, 0.01),
            "hand_eye_error_mm": uniform(0, 0.1),
            "hand_eye_error_deg": uniform(0, 0.01),
        },
    },
    "helix": ({"part": {"spine": HELIX}}, twist, {"way": {"follow": "section"}}),
    "ring": ring,
    "one_phase": one_phase,
    "one_phase_bright": (one_phase, {"scanner": {"intensity": True}}),
    "time_offset": (SWAY, {"robot": {"time_offset_s": uniform(-0.005, 0.005)}}),
    "stop_and_go": {"way": {"motion": "stop_and_go"}},
    "rough": {"part": {"roughness": {"sd_mm": 0.1, "correlation_mm": log_uniform(1, 4)}}},
    "mixed": mixed,
}
EVERY = OTHERS | SHAPES | FAULTS
_RAW = ("plain", *SHAPES, "ring", "rough", "rounded", "burr_out", "burr_in", "lost_blocks", "texture", "clamps")
SWEPT_CONDITIONS = {f"swept_{name}": condition for name, condition in EVERY.items() if name != "rough"}
RAW_SWEPT_CONDITIONS = {f"swept_raw_{name}": EVERY[name] for name in (*_RAW, "mixed")}
