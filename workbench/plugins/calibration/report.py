"""`calibrate.report`: the calibration as a chapter of the report."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from dataclasses import replace
from html import escape

import numpy as np

from workbench.api import DEG, Chapter, Part, Recording, rpy_from_rotation, stage
from workbench.plugins.calibration import pictures
from workbench.plugins.calibration.values import Calibration, PosturePlan, SphereProfiles, Validation

MOST_ROWS = 40  # of the table of postures
BLUE, PURPLE, ORANGE = pictures.BLUE, pictures.PURPLE, pictures.ORANGE


@stage("calibrate.report")
def report(
    calibration: Calibration,
    profiles: SphereProfiles,
    recording: Recording,
    plan: PosturePlan | None = None,
    validation: Validation | None = None,
) -> Chapter:
    """Tell the calibration: profiles, sphere centres (the paper's Fig. 5), residuals, uncertainties, what to do next.

    Args:
        calibration: from `calibrate.hand_eye`.
        profiles: its circles.
        recording: its points.
        plan: where the next posture would help most.
        validation: errors on held-out postures.
    """
    parts = [
        _answer(calibration),
        *_uncertainty(calibration),
        *_centres(calibration),
        *_residuals(calibration),
        *_profiles(calibration, profiles, recording),
        *(_validation(validation) if validation else ()),
        *(_plan(calibration, plan) if plan else ()),
    ]
    return Chapter(
        title="Hand-eye calibration",
        html="\n".join(parts),
        part=_named(recording),
        summary=f"Predicted error over the field of view {calibration.volume_u_mm:.3f} mm (1 u), from "
        f"{int(calibration.used.sum())} of {len(calibration.used)} postures.",
        warnings=calibration.warnings,
    )


def _named(recording: Recording) -> Part:
    """The recording's part; a sphere without a name by its size."""
    part = recording.part
    return part if part.part_id else replace(part, part_id=f"Sphere of {recording.sphere_diameter_mm:g} mm")


def _answer(found: Calibration) -> str:
    """Pose, sphere and clock, each with its uncertainty."""
    pose, u = found.hand_eye.flange_from_profiler, np.sqrt(np.diagonal(found.covariance))
    angles = ", ".join(f"{angle / DEG:.3f}°" for angle in rpy_from_rotation(pose[:3, :3]))
    facts = [
        ("Predicted RMS error of a point over the field of view", f"{found.volume_u_mm:.3f} mm"),
        (
            "Translation tx, ty, tz",
            ", ".join(f"{v:.3f} ± {s:.3f}" for v, s in zip(pose[:3, 3], u, strict=False)) + " mm",
        ),
        ("Rotation roll, pitch, yaw", angles),
        ("u of the rotation about the flange's axes", ", ".join(f"{s / DEG:.4f}°" for s in u[3:])),
        ("Sphere in the base", ", ".join(f"{v:.3f}" for v in found.sphere_center_mm) + " mm"),
        ("Sphere diameter, estimated", f"{2 * found.sphere_radius_mm:.3f} mm"),
        ("Residual of the points, RMS", f"{found.residual_rms_mm:.3f} mm"),
        ("Misfit (1: as the stated noise predicts)", f"{found.misfit:.2f}"),
        ("Method", found.method),
    ]
    if found.time_offset_s is not None and found.time_offset_u_s is not None:
        facts.append(
            (
                "Profiler's clock ahead of the robot's",
                f"{1e3 * found.time_offset_s:.2f} ± {1e3 * found.time_offset_u_s:.2f} ms",
            )
        )
    if found.systematic_mm is not None:
        facts.append(("Systematic robot error, an axis", f"{found.systematic_mm:.2f} mm"))
    rows = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    return f'<dl class="facts">{rows}</dl>'


def _uncertainty(found: Calibration) -> Iterable[str]:
    yield "<h3>What is known well, and what is not</h3>"
    rows = [(words, f"{u:.3f}") for words, u in found.directions]
    yield _table(("Principal direction of the uncertainty, worst first", "u over the field of view, mm"), rows)
    yield _note(
        "A rotation is about the middle of the sphere centres and counts by what it moves at the RMS "
        "distance of the field of view (± 16 by ± 20 mm)."
    )


def _centres(found: Calibration) -> Iterable[str]:
    yield "<h3>Sphere centres in the base</h3>"
    yield _figure(
        pictures.centres_picture(found),
        "Sphere centres in the base, before and after",
        "Each posture's measured sphere centre in the base, less the mean: by the design's hand-eye pose and "
        "by the answer. One scale a row; × rejected. The spread after the calibration is no measure of its "
        "error: it is small along whatever the postures do not determine.",
    )


def _residuals(found: Calibration) -> Iterable[str]:
    yield "<h3>Residuals of each posture</h3>"
    yield _figure(
        pictures.residuals_picture(found),
        "Distance of each posture from the fit of the others",
        f"Distance from the fit of all other postures, in standard deviations of profile, robot and fit "
        f"together. {_key(ORANGE, f'beyond {pictures.LARGE:g}')}{_key(PURPLE, 'rejected')}",
    )
    rows = []
    for i in np.argsort(-found.distance, kind="stable")[:MOST_ROWS]:
        frames = found.frames[i]
        named = f"{frames[0]}" if len(frames) == 1 else f"{frames[0]} to {frames[-1]}"
        dx, dz, dw = found.residual[i]
        x, y, z = found.centre_mm[i]
        rows.append(
            (
                f"{i + 1}",
                named,
                f"{x:.1f}, {y:.1f}, {z:.1f}",
                f"{dx:+.3f}",
                f"{dz:+.3f}",
                f"{dw:+.2f}",
                f"{found.distance[i]:.1f}",
                "used" if found.used[i] else "rejected",
            )
        )
    yield _table(
        ("Posture", "Frames", "Sphere centre in the profiler, mm", "x, mm", "z, mm", "r², mm²", "Distance", ""),
        sorted(rows, key=lambda row: int(row[0])),
    )
    if len(found.distance) > MOST_ROWS:
        yield _note(f"The {MOST_ROWS} of {len(found.distance)} that lie farthest.")
    if found.frames_rejected:
        yield "<h3>Frames that do not count</h3>"
        yield _table(
            ("Frame", "Cause"), [(f"{one.frame}", one.cause) for one in found.frames_rejected[:MOST_ROWS]], True
        )


def _profiles(found: Calibration, profiles: SphereProfiles, recording: Recording) -> Iterable[str]:
    yield "<h3>Profiles and their circles</h3>"
    count = len(found.frames)
    which = (
        f"The {pictures.MOST_PROFILES} of {count} postures that fit worst" if count > pictures.MOST_PROFILES else "All"
    )
    yield _figure(
        pictures.profiles_picture(found, profiles, recording),
        "Profiles with fitted circles",
        f"{which}; of repeats the first. {_key(BLUE, 'points of the arc')}{_key(PURPLE, 'points left out')}"
        f"{_key(ORANGE, 'circle and its centre')} Points scatter by {profiles.noise_mm:.4f} mm (one sigma "
        f"along z) about their circles.",
    )


def _validation(found: Validation) -> Iterable[str]:
    yield "<h3>Errors on held-out postures</h3>"
    yield (
        f"<p>{escape(found.how.capitalize())}: error of the sphere's centre in x and z {found.rms_mm:.3f} mm RMS, "
        f"expected from the uncertainties {found.expected_mm:.3f} mm; chi-square over degrees of freedom "
        f"{found.misfit:.2f} on {found.freedom}.</p>"
    )
    rows = [
        (f"{frames[0]}", *(_pair(e, u) for e, u in zip(error, spread, strict=True)))
        for frames, error, spread in zip(found.frames, found.error_mm, found.u_mm, strict=True)
    ]
    yield _table(("First frame", "x: error, u, mm", "y: error, u, mm", "z: error, u, mm"), rows[:MOST_ROWS])


def _pair(error: float, u: float) -> str:
    return f"{error:+.3f}, {u:.3f}" if np.isfinite(error) else "–"


def _plan(found: Calibration, plan: PosturePlan) -> Iterable[str]:
    yield "<h3>Where the next posture would help most</h3>"
    yield (
        f"<p>Now {plan.volume_u_mm[0]:.3f} mm over the field of view; "
        f"after the {len(plan.centre_mm)} postures proposed {plan.volume_u_mm[-1]:.3f} mm.</p>"
    )
    rows = []
    for i, (pose, centre) in enumerate(zip(plan.base_from_flange, plan.centre_mm, strict=True), 1):
        angles = ", ".join(f"{angle / DEG:.2f}" for angle in rpy_from_rotation(pose[:3, :3]))
        rows.append(
            (
                f"{i}",
                ", ".join(f"{v:.1f}" for v in pose[:3, 3]),
                angles,
                ", ".join(f"{v:.1f}" for v in centre),
                f"{plan.volume_u_mm[i]:.3f}",
            )
        )
    yield _table(
        (
            "Next",
            "Flange in the base, mm",
            "Roll, pitch, yaw, deg",
            "Sphere centre in the profiler, mm",
            "u after it, mm",
        ),
        rows,
    )
    yield _figure(
        pictures.plan_picture(found, plan),
        "Gain of one more posture by its tilt, and places in the view",
        "Left: uncertainty after one more posture, by the tilt of the range axis from the mean orientation "
        f"of the recording, the sphere in its best place. Right: the view; {_key(BLUE, 'measured')}"
        f"{_key(ORANGE, 'proposed')} filled: the centre lies beyond the laser plane (y &gt; 0).",
    )


def _figure(picture: bytes, words: str, caption: str) -> str:
    """`caption` is HTML."""
    address = f"data:image/svg+xml;base64,{base64.b64encode(picture).decode()}"
    return f'<figure><img src="{address}" alt="{escape(words)}"/><figcaption>{caption}</figcaption></figure>'


def _key(colour: str, words: str) -> str:
    return f'<span class="key"><i style="background:{colour}"></i>{escape(words)}</span>'


def _note(words: str) -> str:
    return f'<p class="note">{escape(words)}</p>'


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]], text_last: bool = False) -> str:
    """A table; every cell is escaped."""
    last = ' class="text"' if text_last else ""
    names = "".join(f"<th{last if i == len(head) - 1 else ''}>{escape(name)}</th>" for i, name in enumerate(head))
    body = "".join(
        "<tr>"
        + "".join(
            f"<td{last if i else ''}>{escape(cell)}</td>" if i else f"<th>{escape(cell)}</th>"
            for i, cell in enumerate(row)
        )
        + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>"
