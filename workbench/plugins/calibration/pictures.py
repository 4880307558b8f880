"""Pictures of a calibration, as SVG bytes that depend on the data alone. mm."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from workbench.api import Float, Recording, pieces
from workbench.plugins.calibration.values import Calibration, PosturePlan, SphereProfiles

MOST_PROFILES = 12
AROUND = 1.8  # of a profile's picture: half its width, in sphere radii
LARGE = 3.0  # standard deviations: a posture beyond is marked


def profiles_picture(calibration: Calibration, profiles: SphereProfiles, recording: Recording) -> bytes:
    """Up to twelve profiles, those that fit worst first: points on the arc, points left out, the fitted circle."""
    worst = np.argsort(-calibration.distance, kind="stable")[:MOST_PROFILES]
    shown = sorted(int(i) for i in worst)
    columns = min(4, len(shown))
    rows = -(-len(shown) // columns)
    with pieces.styled():
        figure = Figure(figsize=(10, 2.45 * rows), layout="constrained")
        grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
        for axes, posture in zip(grid, shown, strict=False):
            _profile(axes, calibration, profiles, recording, posture)
        for axes in grid[len(shown) :]:
            axes.set_axis_off()
        return pieces.svg(figure)


def _profile(
    axes: Axes, calibration: Calibration, profiles: SphereProfiles, recording: Recording, posture: int
) -> None:
    frame = calibration.frames[posture][0]
    circle = profiles.circle[int(np.flatnonzero(profiles.frame == frame)[0])]
    x, z, on = recording.x_mm[frame], recording.z_mm[frame], profiles.on_arc[frame]
    half = AROUND * profiles.sphere_diameter_mm / 2
    near = (np.abs(x - circle[0]) < half) & (np.abs(z - circle[1]) < half)
    with np.errstate(invalid="ignore"):
        axes.plot(x[near & ~on], z[near & ~on], ".", color=pieces.PURPLE, markersize=2.5)
        axes.plot(x[near & on], z[near & on], ".", color=pieces.BLUE, markersize=2.5)
    angle = np.linspace(0, 2 * np.pi, 200)
    r = np.sqrt(circle[2])
    axes.plot(circle[0] + r * np.cos(angle), circle[1] + r * np.sin(angle), color=pieces.ORANGE, linewidth=0.8)
    axes.plot(circle[0], circle[1], "+", color=pieces.ORANGE, markersize=6)
    axes.set_xlim(circle[0] - half, circle[0] + half)
    axes.set_ylim(circle[1] - half, circle[1] + half)
    axes.set_aspect("equal")
    if profiles.sense < 0:  # drawn as the sensor sees it: from above
        axes.invert_yaxis()
    state = "" if calibration.used[posture] else ", rejected"
    axes.set_title(
        f"posture {posture + 1}{state}", fontsize=9, color=pieces.INK if calibration.used[posture] else pieces.PURPLE
    )


def centres_picture(calibration: Calibration) -> bytes:
    """Sphere centres in the base, with the nominal and with the calibrated hand-eye pose (the paper's Fig. 5)."""
    sets = [("with the calibrated pose", calibration.center_base_mm, pieces.BLUE)]
    if np.isfinite(calibration.center_base_before_mm).all():
        sets.insert(0, ("with the nominal pose", calibration.center_base_before_mm, pieces.GREY))
    with pieces.styled():
        figure = Figure(figsize=(10, 3.1 * len(sets)), layout="constrained")
        grid = figure.subplots(len(sets), 3, squeeze=False)
        for row, (name, centre, colour) in zip(grid, sets, strict=True):
            mean = centre[calibration.used].mean(axis=0)
            for axes, (a, b) in zip(row, ((0, 1), (0, 2), (1, 2)), strict=True):
                _centres(axes, centre - mean, calibration, (a, b), colour)
            row[0].set_title(f"{name}, mean ({', '.join(f'{v:.2f}' for v in mean)})", loc="left", fontsize=9)
        return pieces.svg(figure)


def _centres(axes: Axes, off: Float, calibration: Calibration, pair: tuple[int, int], colour: str) -> None:
    a, b = pair
    axes.axhline(0, color=pieces.PALE, linewidth=0.7)
    axes.axvline(0, color=pieces.PALE, linewidth=0.7)
    axes.plot(off[calibration.used, a], off[calibration.used, b], "o", color=colour, markersize=4)
    axes.plot(off[~calibration.used, a], off[~calibration.used, b], "x", color=pieces.PURPLE, markersize=6)
    for i in np.flatnonzero(calibration.used) if len(off) <= 2 * MOST_PROFILES else ():
        axes.annotate(
            str(i + 1), (off[i, a], off[i, b]), (3, 3), textcoords="offset points", fontsize=7, color=pieces.GREY
        )
    reach = 1.25 * max(float(np.abs(off[calibration.used]).max()), 1e-3)  # one scale for the row
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_xlabel(f"{'xyz'[a]} less its mean, mm")
    axes.set_ylabel(f"{'xyz'[b]}, mm")
    axes.set_aspect("equal")


def residuals_picture(calibration: Calibration) -> bytes:
    """How far each posture lies from the fit of the others, in standard deviations."""
    count = len(calibration.distance)
    with pieces.styled():
        figure = Figure(figsize=(10, 2.6), layout="constrained")
        axes = figure.subplots()
        number = np.arange(1, count + 1)
        large = calibration.distance > LARGE
        for which, colour in (
            (calibration.used & ~large, pieces.BLUE),
            (calibration.used & large, pieces.ORANGE),
            (~calibration.used, pieces.PURPLE),
        ):
            axes.bar(number[which], np.minimum(calibration.distance[which], 12), color=colour, width=0.7)
        axes.axhline(np.sqrt(3), color=pieces.GREY, linewidth=0.8, dashes=(4, 2))
        axes.annotate(
            "expected", (count + 0.5, np.sqrt(3)), (2, 2), textcoords="offset points", fontsize=8, color=pieces.GREY
        )
        axes.set_xlim(0.4, count + 0.6)
        axes.set_ylim(0, min(12.5, max(4.0, 1.1 * float(calibration.distance.max()))))
        axes.set_xlabel("posture" if count < 40 else "posture, or frame of a scan")
        axes.set_ylabel("distance over its u")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        return pieces.svg(figure)


def plan_picture(calibration: Calibration, plan: PosturePlan) -> bytes:
    """Where one more posture would help most: by the tilt of the range axis, and where the sphere lies in the view."""
    with pieces.styled():
        figure = Figure(figsize=(10, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        tilt = plan.map_tilt_deg
        inside = np.hypot(tilt[:, None], tilt) <= plan.cone_deg  # the map's corners lie beyond the cone
        known = plan.map_volume_u_mm[inside]
        levels = np.linspace(known.min(), max(known.max(), known.min() + 1e-9), 13)
        drawn = left.contourf(tilt, tilt, plan.map_volume_u_mm.T, levels=levels, cmap="viridis_r", extend="min")
        drawn.set_clip_path(Circle((0, 0), plan.cone_deg, transform=left.transData))
        figure.colorbar(drawn, ax=left, format="%.3g", label="u over the field of view after it, mm")
        left.set_xlabel("tilt about the profiler's x, °")
        left.set_ylabel("tilt about the profiler's y, °")
        left.set_aspect("equal")
        _places(right, calibration, plan)
        return pieces.svg(figure)


def _places(axes: Axes, calibration: Calibration, plan: PosturePlan) -> None:
    """The view: where the sphere was, and where the plan puts it; filled: beyond the laser plane (y > 0)."""
    for centre, colour, marker in (
        (calibration.centre_mm[calibration.used], pieces.BLUE, "o"),
        (plan.centre_mm, pieces.ORANGE, "s"),
    ):
        for here, face in ((centre[:, 1] > 0, colour), (centre[:, 1] <= 0, "none")):
            axes.plot(
                centre[here, 0], centre[here, 2], marker, markerfacecolor=face, markeredgecolor=colour, markersize=6
            )
    for i, (x, _, z) in enumerate(plan.centre_mm, 1):
        axes.annotate(str(i), (x, z), (5, 4), textcoords="offset points", fontsize=8, color=pieces.ORANGE)
    (x, z), (w, h) = plan.middle_mm, plan.half_mm
    axes.plot(
        [x - w, x + w, x + w, x - w, x - w], [z - h, z - h, z + h, z + h, z - h], color=pieces.PALE, linewidth=1.0
    )
    axes.set_xlabel("x in the profiler, mm")
    axes.set_ylabel("z in the profiler, mm")
    axes.set_aspect("equal")
