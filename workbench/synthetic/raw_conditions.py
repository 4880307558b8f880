"""Random raw edges under named conditions, drawn as the milled parts are.

Recorded hand-eye and the two poses of a straight motion are exact here, unless a condition says otherwise: an error
of theirs moves the whole edge in the base, no recording shows it, and it belongs to the mechanics. Poses of a stream
are as noisy as on milled parts.
"""

from __future__ import annotations

from workbench.synthetic import milled_conditions as milled
from workbench.synthetic.draws import Document, Generator, draw_course, draw_pass
from workbench.synthetic.milled_conditions import Condition


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


def raw(condition: Condition) -> Condition:
    """A raw plate under a condition of milled parts."""

    def change(rng: Generator, document: Document) -> None:
        straight(rng, document)
        condition(rng, document)

    return change


def drift(rng: Generator, document: Document) -> None:
    """The thickness drifts by 5 % from end to end."""
    straight(rng, document)
    mean = rng.uniform(5, 12)
    change = float(rng.choice([-1, 1])) * 0.05 * mean
    course = draw_course(rng, mean, 0.0, 0.05)
    document["part"]["thickness_mm"] = course | {"start": mean - change / 2, "end": mean + change / 2}


def rough(rng: Generator, document: Document) -> None:
    """End face rough by 0.3 mm."""
    straight(rng, document)
    document["part"]["roughness_mm"] = 0.3


def twist(rng: Generator, document: Document) -> None:
    """The end face turns about the edge by up to 30 deg in 150 mm."""
    straight(rng, document)
    document["part"]["end_face_twist_deg"] = rng.uniform(-30, 30) * min(1.0, document["part"]["length_mm"] / 150)


def burrs(rng: Generator, document: Document) -> None:
    """One to four of them, at either edge of the end face."""
    straight(rng, document)
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
    straight(rng, document)
    document["part"]["table_gap_mm"] = None
    _set_passes(document, draw_pass(rng, document, (-70, -20)))


def two_pass(rng: Generator, document: Document) -> None:
    """From above and from below."""
    straight(rng, document)
    document["part"]["table_gap_mm"] = None
    _set_passes(document, document["passes"][0], draw_pass(rng, document, (-70, -20)))


def square(rng: Generator, document: Document) -> None:
    """Only the end face returns: the view grazes both surfaces."""
    straight(rng, document)
    scan = draw_pass(rng, document, (-7, 7))
    _set_passes(document, scan | {"lead_deg": rng.uniform(-3, 3), "turn_deg": [0, 0, 0]})
    document["scanner"].update(max_incidence_deg=78, sampling="lateral", beam="parallel")


def robot(rng: Generator, document: Document) -> None:
    """Hand-eye and poses as much in error as on milled parts: the whole edge is displaced."""
    errors = dict(document["robot"])
    straight(rng, document)
    document["robot"].update(errors)


RAW_CONDITIONS: dict[str, Condition] = {
    "raw_straight": straight,
    "raw_arc": raw(milled.arc),
    "raw_wavy": raw(milled.wavy),
    "raw_drift": drift,
    "raw_outliers_5": raw(milled.outliers),
    "raw_missing_20": raw(milled.missing),
    "raw_clamps": raw(milled.clamps),
    "raw_rough": rough,
    "raw_twist": twist,
    "raw_burrs": burrs,
    "raw_below": below,
    "raw_two_pass": two_pass,
    "raw_square": square,
    "raw_robot": robot,
}
