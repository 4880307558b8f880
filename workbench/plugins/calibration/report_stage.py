"""`calibrate.report`: the calibration as a chapter of the report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from workbench.api import DEG, Chapter, Recording, pieces, plot, rpy_from_rotation, stage
from workbench.plugins.calibration.tables import left_out_html, sentence
from workbench.plugins.calibration.values import Calibration, PosturePlan, SphereProfiles, Validation
from workbench.plugins.calibration.verdicts import directions_html, pose_facts

MOST_ROWS = 40  # of the table of postures
MOST_PROFILES = 12
AROUND = 1.8  # of a profile's picture: half its width, in sphere radii
MOST_TICKS = 5  # of a chart
LARGE = 3.0  # standard deviations: a posture beyond is marked


@stage("calibrate.report")
def report(
    calibration: Calibration,
    profiles: SphereProfiles,
    recording: Recording,
    plan: PosturePlan | None = None,
    validation: Validation | None = None,
) -> Chapter:
    """The calibration as a chapter: profiles, sphere centres (Fig. 5), residuals, uncertainties, what next.
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
    part, (across, deep) = recording.part, calibration.view.half_mm
    parts = [
        _answer(calibration),
        pieces.heading("Principal directions of the uncertainty"),
        directions_html(calibration.directions),
        pieces.note(
            "A rotation is one about the middle of the field of view; its u is the displacement at the RMS distance of "
            f"the field's points (± {across:.0f} mm by ± {deep:.0f} mm)."
        ),
        pieces.heading("Sphere centres in the base"),
        pieces.figure_html(
            centres_picture(calibration),
            "Sphere centres in the base, before and after",
            "The sphere centre in the base as each posture gives it, less the mean, with the nominal and with the "
            "calibrated hand-eye pose. One scale per row; × rejected. The scatter after the calibration is no measure "
            "of its error: it is small in every direction that the postures do not determine.",
        ),
        *_residuals(calibration),
        *_profiles(calibration, profiles, recording),
        *(_validation(validation) if validation else ()),
        *(_plan(plan) if plan else ()),
    ]
    return Chapter(
        title="Hand-eye calibration",
        html="\n".join(parts),
        part=part if part.part_id else replace(part, part_id=f"Sphere of {recording.sphere_diameter_mm:g} mm"),
        summary=f"Predicted error over the field of view {calibration.volume_u_mm:.3f} mm (standard uncertainty), from "
        f"{int(calibration.used.sum())} of {len(calibration.used)} postures; {calibration.verdict}.",
        warnings=calibration.warnings,
    )


def _answer(found: Calibration) -> str:
    """Pose, sphere and clock, each with its uncertainty."""
    offset, u = found.time_offset_s, found.time_offset_u_s
    facts = [
        *pose_facts(found.hand_eye, None if offset is None or u is None else (offset, u)),
        ("Sphere in the base", ", ".join(f"{v:.3f}" for v in found.sphere_center_mm) + " mm"),
        ("Sphere diameter, estimated", f"{2 * found.sphere_radius_mm:.3f} mm"),
        ("Residual of the points, RMS", f"{found.residual_rms_mm:.3f} mm"),
        ("Residuals over the stated noise (chi-square over degrees of freedom)", f"{found.misfit:.2f}"),
        ("Method", found.method),
    ]
    if found.systematic_mm is not None:
        facts.append(("Systematic robot error, each axis", f"{found.systematic_mm:.2f} mm"))
    return pieces.facts_html(facts) + pieces.paragraph(sentence(found.verdict)) + left_out_html(found.not_included)


def _residuals(found: Calibration) -> Iterable[str]:
    yield pieces.heading("Residuals of the postures")
    yield pieces.figure_html(
        residuals_picture(found),
        "Distance of each posture from the fit of the others",
        "Distance of each posture from the fit of all others over its standard uncertainty (profile, robot and fit).",
        ((pieces.ORANGE, f"beyond {LARGE:g}"), (pieces.PURPLE, "rejected")),
    )
    shown = np.sort(np.argsort(-found.distance, kind="stable")[:MOST_ROWS])
    frames = [found.frames[i] for i in shown]
    columns = {
        "Posture": ("{}", shown + 1),
        "Frames": ("{}", [f"{one[0]}" if len(one) == 1 else f"{one[0]} to {one[-1]}" for one in frames]),
        "Sphere centre in the profiler, mm": ("{:.1f}, {:.1f}, {:.1f}", found.centre_mm[shown]),
        "x, mm": ("{:+.3f}", found.residual[shown, 0]),
        "z, mm": ("{:+.3f}", found.residual[shown, 1]),
        "r², mm²": ("{:+.2f}", found.residual[shown, 2]),
        "Distance / u": ("{:.1f}", found.distance[shown]),
        "Use": ("{}", np.where(found.used[shown], "used", "rejected")),
    }
    yield pieces.columns_html(columns, text=(7,))
    if len(found.distance) > MOST_ROWS:
        yield pieces.note(f"The {MOST_ROWS} postures with the largest residuals, of {len(found.distance)}.")
    if found.frames_rejected:
        yield pieces.heading("Rejected frames")
        rejected = [(f"{one.frame}", one.cause) for one in found.frames_rejected[:MOST_ROWS]]
        yield pieces.table_html(("Frame", "Cause"), rejected, text=(1,))


def _profiles(found: Calibration, profiles: SphereProfiles, recording: Recording) -> Iterable[str]:
    yield pieces.heading("Profiles and fitted circles")
    count, most = len(found.frames), MOST_PROFILES
    which = f"The {most} of {count} postures with the largest residuals" if count > most else "All postures"
    yield pieces.figure_html(
        profiles_picture(found, profiles, recording),
        "Profiles with fitted circles",
        f"{which}; of repeated profiles the first. Standard deviation of the points about their circles along z: "
        f"{profiles.noise_mm:.4f} mm.",
        (
            (pieces.BLUE, "points on the arc"),
            (pieces.PURPLE, "points left out"),
            (pieces.ORANGE, "circle and its centre"),
        ),
    )


def _validation(found: Validation) -> Iterable[str]:
    yield pieces.heading("Errors on held-out postures")
    yield pieces.paragraph(
        f"{found.how.capitalize()}: error of the sphere's centre in x and z {found.rms_mm:.3f} mm RMS, expected from "
        f"the uncertainties {found.expected_mm:.3f} mm; chi-square over degrees of freedom {found.misfit:.2f} on "
        f"{found.freedom}."
    )
    rows = [
        (f"{frames[0]}", *(f"{e:+.3f}, {u:.3f}" if np.isfinite(e) else "–" for e, u in zip(error, spread, strict=True)))
        for frames, error, spread in zip(found.frames, found.error_mm, found.u_mm, strict=True)
    ]
    head = ("First frame", "x: error, u, mm", "y: error, u, mm", "z: error, u, mm")
    yield pieces.table_html(head, rows[:MOST_ROWS])


def _plan(plan: PosturePlan) -> Iterable[str]:
    yield pieces.heading("Proposed further postures")
    yield pieces.paragraph(
        f"u over the field of view after the {len(plan.centre_mm)} postures proposed: "
        f"{plan.volume_u_mm[-1]:.3f} mm, {plan.volume_u_mm[0]:.3f} mm now."
    )
    rpy_deg = [np.array(rpy_from_rotation(pose[:3, :3])) / DEG for pose in plan.base_from_flange]
    columns = {
        "Next": ("{}", range(1, len(rpy_deg) + 1)),
        "Flange in the base, mm": ("{:.1f}, {:.1f}, {:.1f}", plan.base_from_flange[:, :3, 3]),
        "Roll, pitch, yaw, °": ("{:.2f}, {:.2f}, {:.2f}", rpy_deg),
        "Sphere centre in the profiler, mm": ("{:.1f}, {:.1f}, {:.1f}", plan.centre_mm),
        "u after it, mm": ("{:.3f}", plan.volume_u_mm[1:]),
    }
    yield pieces.columns_html(columns)


def profiles_picture(calibration: Calibration, profiles: SphereProfiles, recording: Recording) -> bytes:
    """Up to twelve profiles, those that fit worst first: points on the arc, points left out, the fitted circle."""
    worst = np.argsort(-calibration.distance, kind="stable")[:MOST_PROFILES]
    columns = min(4, len(worst))
    figure = plot.Figure((10.0, 2.6 * -(-len(worst) // columns)))
    grid = figure.subplots(-(-len(worst) // columns), columns)
    for axes, posture in zip_longest(grid, sorted(worst.tolist())):
        axes.visible = posture is not None
        if axes.visible:
            _profile(axes, calibration, profiles, recording, posture)
    return figure.svg()


def _profile(
    axes: plot.Axes, calibration: Calibration, profiles: SphereProfiles, recording: Recording, posture: int
) -> None:
    frame, used = calibration.frames[posture][0], calibration.used[posture]
    middle_x, middle_z, w = profiles.circle[int(np.flatnonzero(profiles.frame == frame)[0])]
    x, z, on = recording.x_mm[frame], recording.z_mm[frame], profiles.on_arc[frame]
    half, up = AROUND * profiles.sphere_diameter_mm / 2, profiles.sense  # drawn as the sensor sees it: from above
    near = (np.abs(x - middle_x) < half) & (np.abs(z - middle_z) < half)
    for chosen, colour in ((near & ~on, pieces.PURPLE), (near & on, pieces.BLUE)):
        axes.points(x[chosen], up * z[chosen], ".", color=colour, markersize=2.5)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    r = np.sqrt(w)
    axes.plot(middle_x + r * np.cos(angle), up * middle_z + r * np.sin(angle), color=pieces.ORANGE, linewidth=0.8)
    axes.points([middle_x], [up * middle_z], "x", color=pieces.ORANGE, markersize=4.0)
    axes.set(xlim=(middle_x - half, middle_x + half), ylim=(up * middle_z - half, up * middle_z + half), aspect="equal")
    ticks, names = plot.nice_ticks((middle_z - half, middle_z + half), MOST_TICKS)
    words = f"posture {posture + 1}{'' if used else ', rejected'}"
    axes.set(yticks=([up * one for one in ticks], names), title=words)


def centres_picture(calibration: Calibration) -> bytes:
    """Sphere centres in the base, with the nominal and with the calibrated hand-eye pose (the paper's Fig. 5)."""
    sets = [("with the calibrated pose", calibration.center_base_mm, pieces.BLUE)]
    if np.isfinite(calibration.center_base_before_mm).all():
        sets.insert(0, ("with the nominal pose", calibration.center_base_before_mm, pieces.GREY))
    used = calibration.used
    figure = plot.Figure((10.0, 3.1 * len(sets)))
    grid = figure.subplots(len(sets), 3, squeeze=False)
    for row, (name, centre, colour) in zip(grid, sets, strict=True):
        mean = centre[used].mean(axis=0)
        off = centre - mean
        reach = 1.25 * max(np.abs(off[used]).max(), 1e-3)  # one scale for the row
        ticks = plot.nice_ticks((-reach, reach), MOST_TICKS)
        for axes, (a, b) in zip(row, ((0, 1), (0, 2), (1, 2)), strict=True):
            axes.axhline(0.0, color=pieces.PALE, linewidth=0.7)
            axes.axvline(0.0, color=pieces.PALE, linewidth=0.7)
            axes.points(off[used, a], off[used, b], "o", color=colour, markersize=4.0)
            axes.points(off[~used, a], off[~used, b], "x", color=pieces.PURPLE)
            for i in np.flatnonzero(used) if len(off) <= 2 * MOST_PROFILES else ():
                axes.annotate(f"{i + 1}", (off[i, a], off[i, b]), (3.0, 3.0), fontsize=7.0)
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xticks=ticks, yticks=ticks, aspect="equal")
            axes.set(xlabel=f"{'xyz'[a]} less its mean, mm", ylabel=f"{'xyz'[b]}, mm")
        row[0].set(title=f"{name}, mean ({', '.join(f'{v:.2f}' for v in mean)}) mm")
    return figure.svg()


def residuals_picture(calibration: Calibration) -> bytes:
    """How far each posture lies from the fit of the others, in standard deviations."""
    count, highest = len(calibration.distance), min(12.5, max(4.0, 1.1 * calibration.distance.max()))
    figure = plot.Figure((10.0, 2.6))
    (axes,) = figure.subplots()
    for number, (off, used) in enumerate(zip(calibration.distance, calibration.used, strict=True), 1):
        colour = pieces.PURPLE if not used else pieces.ORANGE if off > LARGE else pieces.BLUE
        x = number + 0.35 * np.array([-1.0, -1.0, 1.0, 1.0])
        axes.fill(x, min(off, highest) * np.array([0.0, 1.0, 1.0, 0.0]), facecolor=colour)
    axes.axhline(np.sqrt(3.0), color=pieces.GREY, linewidth=0.8, dashes=(4.0, 2.0))
    axes.annotate("expected", (1.0, np.sqrt(3.0)), (-2.0, 3.0), xycoords=("axes fraction", "data"), ha="right")
    axes.integer = "x"
    axes.set(xlim=(0.4, count + 0.6), ylim=(0.0, highest), ylabel="distance over its u")
    axes.set(xlabel="posture" if count < MOST_ROWS else "posture, or frame of a scan")
    return figure.svg()
