"""Root face and bevel angle along a milled edge, each with its uncertainty by source (docs/method.md, section 5)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.artefacts import DECLARED, DIRECTIONS, END, FORM, HIDDEN, ROUNDING, STEPS, TANGENT, Quantity
from workbench.edge.directions import LOCAL_MM
from workbench.edge.measure import Measured, face_angles
from workbench.edge.residual_image import FaceForm
from workbench.units import DEG, Bool, Float, Shaped

SUDDEN_MM, REACH_MM = 0.03, 4.0  # a change of the root face by this is told, from so far before to so far after it
MOST = 0.7  # of the edge at one level: what lies off it is an end lost or drawn out
BESIDE = 3  # stations on each side of a change, whose mean is the level there
NEAR_MM = 1.5  # of a section: frames that speak for it
SUDDEN_SLOPE = 0.006  # a root face that is milled straight does not change so fast
UNUSUAL_SLOPES = 3.0  # times what is usual on the edge: waves are steep everywhere, lost returns and burrs are not
SUDDEN_SIGMAS = 4.0


class EndTerms(NamedTuple):
    """What the root face's course leaves open of its end, at m stations."""

    level_mm: Shaped[Float, " m"]  # correction by the levels between which the end steps
    level_u_mm: Shaped[Float, " m"]
    broken_u_mm: Shaped[Float, " m"]  # of what a rounding or a chamfer hides
    hidden_u_mm: Shaped[Float, " m"]  # of columns that never return, or a gap over what the plate lies on
    declared_u_mm: float
    steep: float  # slope of the root face to the rays' normal


def sizes(
    measured: Measured,
    at: Float,
    tangent_u: Float,
    root_form: FaceForm,
    bevel_form: FaceForm,
    end: EndTerms,
) -> tuple[Quantity, Quantity]:
    """Root face and bevel angle at arc lengths `at` (m,) of the lower edge.

    tangent_u (m,) rad; root_form, bevel_form: what lasts in the residuals of both faces.
    """
    s = at + measured.shift
    tilt_u, bevel_u, angle_u = direction_u(measured, s)
    _, beta = corrected_angles(measured, s)
    root = measured.end.course.value(s) + end.level_mm
    lever = _along(measured, measured.lever_mm, s)
    run_root, run_bevel = _along(measured, measured.faces.root.run, s), _along(measured, measured.faces.bevel.run, s)
    leverage = np.sqrt(np.maximum(run_root**2 + run_bevel**2 - 2.0 * run_root * run_bevel * np.cos(beta), 0.0))
    # What obliquity makes of the root face's drift.
    drift_u = np.abs(run_bevel) * np.sin(beta) * measured.end.course.slope_u(s)
    turned = np.hypot(lever / np.sin(beta) * bevel_u, 0.5 * root / np.abs(np.tan(beta)) * tilt_u)
    # The end comes along the rays onto the root face's line, the corner is where both lines cross.
    corner = root_form.upper_u_mm / np.tan(beta), root_form.lower_u_mm * end.steep, bevel_form.lower_u_mm / np.sin(beta)
    root_u = {
        END: measured.end.course.u(s),
        STEPS: end.level_u_mm,
        HIDDEN: end.hidden_u_mm,
        DIRECTIONS: turned,
        TANGENT: tangent_u * np.abs(run_root) * root,
        FORM: np.sqrt(sum(of**2 for of in corner)),
        ROUNDING: end.broken_u_mm,
        DECLARED: np.full(at.size, end.declared_u_mm),
    }
    angle = {
        DIRECTIONS: np.hypot(angle_u, drift_u),
        TANGENT: tangent_u * leverage,
        FORM: np.hypot(root_form.turn_u, bevel_form.turn_u),
    }
    return (
        Quantity.of("root_mm", root, root_u),
        Quantity.of("bevel_deg", beta / DEG, {name: u / DEG for name, u in angle.items()}),
    )


def off_levels(at: Float, level: Float, least: float, seen: Bool | bool = True) -> tuple[Float, Float]:
    """As `off_commonest`; and no stretch between gaps lends its level to another: it may change under the gap."""
    over, off = off_commonest(level, least)
    there = np.flatnonzero(np.broadcast_to(seen, at.shape))
    for stretch in np.split(there, np.flatnonzero(np.diff(at[there]) > 2.0 * REACH_MM) + 1):
        if stretch.size:
            off[stretch] = np.maximum(off[stretch], off_commonest(level[stretch], least)[1])
    return over, off


def off_commonest(level: Float, least: float = SUDDEN_MM) -> tuple[Float, Float]:
    """How far each station (m,) lies over the commonest level, and what that makes uncertain."""
    rising = np.sort(level)
    near = np.searchsorted(rising, level + least) - np.searchsorted(rising, level - least, side="right")
    share = near / level.size
    over = level - level[np.argmax(share)]
    off = np.abs(over)
    if share.max() < MOST:  # the true one may be any that lasts
        off = np.maximum(off, np.ptp(level[share >= min(float(share.max()), 0.5 * (1.0 - MOST))]))
    return np.where(np.abs(over) < least, 0.0, over), np.where(off < least, 0.0, off)


def changes(
    at: Float,
    value: Float,
    u: Float,
    least: float = SUDDEN_MM,
    least_slope: float = SUDDEN_SLOPE,
    seen: Bool | bool = True,
    reach_mm: float = REACH_MM,
) -> list[tuple[int, int, float]]:
    """The sudden changes of `sudden`: first and last station, and by how much the size changes between them.

    Beyond what it does on both sides: where a wave is steep it is so over some way, and beside it nearly as steep.
    reach_mm: beside what is steep, that belongs to the change.
    """
    if at.size < 3:
        return []
    reach = max(1, round(reach_mm / float(np.median(np.diff(at)))))
    if not np.all(seen):
        if not np.any(seen):
            return []
        value = np.interp(at, at[seen], value[seen])
    rate = np.gradient(value, at)
    slope = np.abs(rate)
    steep = np.flatnonzero(slope > max(least_slope, UNUSUAL_SLOPES * float(np.median(slope))))
    out = _under_gaps(at, value, rate, np.broadcast_to(seen, at.shape), np.maximum(least, SUDDEN_SIGMAS * u))
    if not steep.size:
        return out
    for run in np.split(steep, np.flatnonzero(np.diff(steep) > 2 * reach) + 1):
        first, last = int(max(run[0] - reach, 0)), int(min(run[-1] + reach, at.size - 1))
        beside = 0.5 * (rate[first] + rate[last]) * (at[first : last + 1] - at[first])
        change = float(min(np.ptp(value[first : last + 1] - beside), np.ptp(value[first : last + 1])))
        if change >= max(least, SUDDEN_SIGMAS * float(max(u[first], u[last]))):  # between them a course cannot follow
            out.append((first, last, change))
    return out


def _under_gaps(at: Float, value: Float, rate: Float, seen: Bool, least: Float) -> list[tuple[int, int, float]]:
    """The changes under gaps of what is `seen` (m,), by how far the slopes on both sides miss the other side."""
    there = np.flatnonzero(seen)
    out = []
    for k in np.flatnonzero(np.diff(there) > 1):
        first, last = int(there[k]), int(there[k + 1])
        before, after = max(first - BESIDE, 0), min(last + BESIDE, at.size - 1)
        way = at[last] - at[first]
        missed = value[last] - value[first] - 0.5 * way * (rate[before] + rate[after])
        change = float(min(abs(missed), abs(value[last] - value[first])))
        if way > 2.0 * REACH_MM and change >= max(least[first], least[last]):
            out.append((first, last, change))
    return out


def direction_u(measured: Measured, s: Float) -> tuple[Float, Float, Float]:
    """Standard uncertainties (m,) of root face, bevel face and the angle between them at s, rad."""
    faces = measured.faces
    bevel_u, apart = faces.bevel_course.u(s), faces.opening_course.value(s)
    alone = faces.root_course.value(s) - faces.bevel_course.value(s)
    mean = (1.0 - faces.follows) * alone + faces.follows * apart
    angle = (1.0 - faces.follows) * (faces.root_course.u(s) ** 2 + bevel_u**2 + (alone - mean) ** 2)
    angle += faces.follows * (faces.opening_course.u(s) ** 2 + bevel_u**2 + (apart - mean) ** 2)
    tilt = (1.0 - faces.follows) * faces.root_course.u(s) ** 2 + faces.follows * faces.opening_course.u(s) ** 2
    if faces.even is not None:
        around = np.mean([_turned(measured, s + off) for off in np.linspace(-0.5, 0.5, 21) * LOCAL_MM], axis=0)
        angle = faces.even.u(s) ** 2 + bevel_u**2 + np.var(around)  # a section's own stretch turns by that
    return np.sqrt(tilt), bevel_u, np.sqrt(angle)


def corrected_angles(measured: Measured, s: Float) -> tuple[Float, Float]:
    """Direction of the root face and bevel angle (m,) at s, rad, obliquity taken back.

    A rough root face turns from place to place: its corner lies where it does, its direction is what 10 mm show.
    """
    tilt, beta = face_angles(
        measured.faces, s, _along(measured, measured.root_turn, s), _along(measured, measured.bevel_turn, s)
    )
    off = _turned(measured, s)
    return tilt - off, beta - off


def rough_deg(measured: Measured, s: Float) -> float:
    """Standard deviation of a rough root face's direction at s (m,) about what 10 mm show, deg."""
    return float(np.std(_turned(measured, s))) / DEG


def _turned(measured: Measured, s: Float) -> Float:
    """By how much a rough root face is turned at s (m,) beside what 10 mm show, rad."""
    even = measured.faces.even
    return np.zeros(s.size) if even is None else face_angles(measured.faces, s)[0] - even.value(s)


def _along(measured: Measured, value: Float, s: Float) -> Float:
    """What frames (N,) have, at arc lengths s (m,) of the curve."""
    on = np.isfinite(measured.upper_s) & np.isfinite(value)
    order = np.flatnonzero(on)[np.argsort(measured.upper_s[on], kind="stable")]
    return np.interp(s, measured.upper_s[order], value[order])
