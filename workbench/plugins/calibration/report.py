"""`calibrate.report`: the calibration as a chapter of the report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from workbench.api import DEG, Chapter, Part, Recording, pieces, rpy_from_rotation, stage
from workbench.plugins.calibration import pictures
from workbench.plugins.calibration.values import Calibration, PosturePlan, SphereProfiles, Validation

MOST_ROWS = 40  # of the table of postures
BLUE, PURPLE, ORANGE = pieces.BLUE, pieces.PURPLE, pieces.ORANGE


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

    Example:
        >>> from workbench import scan
        >>> from workbench.plugins import calibration
        >>> ball = scan.read(recording="data/synthetic/sphere.h5")
        >>> arcs = calibration.circles(ball)
        >>> pose, found, document = calibration.hand_eye(arcs, ball)
        >>> calibration.report(found, arcs, ball).title
        'Hand-eye calibration'
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
        summary=f"Predicted error over the field of view {calibration.volume_u_mm:.3f} mm (standard uncertainty), from "
        f"{int(calibration.used.sum())} of {len(calibration.used)} postures; {calibration.verdict}.",
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
        ("Residuals over the stated noise (chi-square over degrees of freedom)", f"{found.misfit:.2f}"),
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
        facts.append(("Systematic robot error, each axis", f"{found.systematic_mm:.2f} mm"))
    return pieces.facts_html(facts) + pieces.paragraph(f"{found.verdict[:1].upper() + found.verdict[1:]}.")


def _uncertainty(found: Calibration) -> Iterable[str]:
    yield pieces.heading("Principal directions of the uncertainty")
    rows = [(words, f"{u:.3f}") for words, u in found.directions]
    yield pieces.table_html(("Direction, least certain first", "u over the field of view, mm"), rows)
    yield pieces.note(
        "A rotation is one about the mean of the sphere centres; its u is the displacement at the RMS distance of "
        "the field of view (± 16 mm by ± 20 mm)."
    )


def _centres(found: Calibration) -> Iterable[str]:
    yield pieces.heading("Sphere centres in the base")
    yield pieces.figure_html(
        pictures.centres_picture(found),
        "Sphere centres in the base, before and after",
        "The sphere centre in the base as each posture gives it, less the mean, with the nominal and with the "
        "calibrated hand-eye pose. One scale per row; × rejected. The scatter after the calibration is no measure of "
        "its error: it is small in every direction that the postures do not determine.",
    )


def _residuals(found: Calibration) -> Iterable[str]:
    yield pieces.heading("Residuals of the postures")
    yield pieces.figure_html(
        pictures.residuals_picture(found),
        "Distance of each posture from the fit of the others",
        "Distance of each posture from the fit of all others over its standard uncertainty (profile, robot and fit).",
        ((ORANGE, f"beyond {pictures.LARGE:g}"), (PURPLE, "rejected")),
    )
    rows = []
    for i in sorted(np.argsort(-found.distance, kind="stable")[:MOST_ROWS]):
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
    head = (
        "Posture",
        "Frames",
        "Sphere centre in the profiler, mm",
        "x, mm",
        "z, mm",
        "r², mm²",
        "Distance / u",
        "Use",
    )
    yield pieces.table_html(head, rows, text=(7,))
    if len(found.distance) > MOST_ROWS:
        yield pieces.note(f"The {MOST_ROWS} postures with the largest residuals, of {len(found.distance)}.")
    if found.frames_rejected:
        yield pieces.heading("Rejected frames")
        rejected = [(f"{one.frame}", one.cause) for one in found.frames_rejected[:MOST_ROWS]]
        yield pieces.table_html(("Frame", "Cause"), rejected, text=(1,))


def _profiles(found: Calibration, profiles: SphereProfiles, recording: Recording) -> Iterable[str]:
    yield pieces.heading("Profiles and fitted circles")
    count, most = len(found.frames), pictures.MOST_PROFILES
    which = f"The {most} of {count} postures with the largest residuals" if count > most else "All postures"
    yield pieces.figure_html(
        pictures.profiles_picture(found, profiles, recording),
        "Profiles with fitted circles",
        f"{which}; of repeated profiles the first. Standard deviation of the points about their circles along z: "
        f"{profiles.noise_mm:.4f} mm.",
        ((BLUE, "points on the arc"), (PURPLE, "points left out"), (ORANGE, "circle and its centre")),
    )


def _validation(found: Validation) -> Iterable[str]:
    yield pieces.heading("Errors on held-out postures")
    yield pieces.paragraph(
        f"{found.how.capitalize()}: error of the sphere's centre in x and z {found.rms_mm:.3f} mm RMS, expected from "
        f"the uncertainties {found.expected_mm:.3f} mm; chi-square over degrees of freedom {found.misfit:.2f} on "
        f"{found.freedom}."
    )
    rows = [
        (f"{frames[0]}", *(_pair(e, u) for e, u in zip(error, spread, strict=True)))
        for frames, error, spread in zip(found.frames, found.error_mm, found.u_mm, strict=True)
    ]
    head = ("First frame", "x: error, u, mm", "y: error, u, mm", "z: error, u, mm")
    yield pieces.table_html(head, rows[:MOST_ROWS])


def _pair(error: float, u: float) -> str:
    return f"{error:+.3f}, {u:.3f}" if np.isfinite(error) else "–"


def _plan(found: Calibration, plan: PosturePlan) -> Iterable[str]:
    yield pieces.heading("Proposed further postures")
    yield pieces.paragraph(
        f"u over the field of view after the {len(plan.centre_mm)} postures proposed: "
        f"{plan.volume_u_mm[-1]:.3f} mm, {plan.volume_u_mm[0]:.3f} mm now."
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
    head = (
        "Next",
        "Flange in the base, mm",
        "Roll, pitch, yaw, °",
        "Sphere centre in the profiler, mm",
        "u after it, mm",
    )
    yield pieces.table_html(head, rows)
    yield pieces.figure_html(
        pictures.plan_picture(found, plan),
        "Gain of one more posture by its tilt, and places in the field of view",
        "Left: u after one more posture, over the tilt of the range axis from the mean orientation of the recording, "
        "with the sphere in its best place. Right: the field of view; filled: the centre lies beyond the laser plane "
        "(y > 0).",
        ((BLUE, "measured"), (ORANGE, "proposed")),
    )
