"""Root size and bevel angle along a milled edge, each with its uncertainty by source (docs/method.md, section 5)."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import DECLARED, DIRECTIONS, END, FORM, ROUNDING, TANGENT, Quantity
from workbench.edge.form import Form, Rounding
from workbench.edge.measure import Measured, face_angles
from workbench.units import Float

SUDDEN_MM, REACH_MM = 0.03, 40.0  # a change of the root size by this, and the edge about it that it is compared with
SUDDEN_SLOPE = 0.02  # over some mm: a machined root face does not change so fast, lost returns and burrs do
SUDDEN_SIGMAS = 4.0


def sizes(
    measured: Measured, at: Float, tangent_u: Float, form: Form, rounding: Rounding, end_u_mm: float
) -> tuple[Quantity, Quantity]:
    """Root size (mm) and bevel angle (rad) at arc lengths `at` (m,) of the lower edge.

    tangent_u (m,) rad; end_u_mm: what is declared of the end of the root face beyond what frames show.
    """
    s = at + measured.shift
    tilt_u, bevel_u, angle_u = direction_u(measured, s)
    _, beta = corrected_angles(measured, s)
    end_u = measured.end.course.u(s)
    root = measured.end.course.value(s) + rounding.beyond_mm
    lever = _along(measured, measured.lever_mm, s)
    run_root, run_bevel = _along(measured, measured.faces.root.run, s), _along(measured, measured.faces.bevel.run, s)
    leverage = np.sqrt(np.maximum(run_root**2 + run_bevel**2 - 2.0 * run_root * run_bevel * np.cos(beta), 0.0))
    # What obliquity makes of the root size's drift.
    drift_u = np.abs(run_bevel) * np.sin(beta) * measured.end.course.slope_u(s)
    turned = np.hypot(lever / np.sin(beta) * bevel_u, 0.5 * root / np.abs(np.tan(beta)) * tilt_u)
    whole = np.ones(at.size)
    root_u = {
        END: np.hypot(end_u, sudden_mm(at, root, end_u)),
        DIRECTIONS: turned,
        TANGENT: tangent_u * np.abs(run_root) * root,
        FORM: form.corner_u_mm,
        ROUNDING: rounding.u_mm * whole,
        DECLARED: end_u_mm * whole,
    }
    angle = {
        DIRECTIONS: np.hypot(angle_u, drift_u),
        TANGENT: tangent_u * leverage,
        FORM: np.hypot(form.root_turn_u, form.bevel_turn_u),
    }
    return Quantity(root, root_u), Quantity(beta, angle)


def sudden_mm(at: Float, root: Float, u: Float) -> Float:
    """By how much the root size leaves its course about it (m,) by a sudden change, mm; 0 elsewhere.

    The end of the face may be lost there, covered, or stand out in its plane: nothing tells which, so all of the
    change is uncertainty.
    """
    out = np.zeros(at.size)
    slope = np.abs(np.gradient(root, at)) if at.size > 2 else out
    about = np.array([np.median(root[np.abs(at - s) <= REACH_MM]) for s in at])
    off = np.abs(root - about)
    for k in np.flatnonzero(off > np.maximum(SUDDEN_MM, SUDDEN_SIGMAS * u)):
        first = last = k  # the stretch that lies off on this side
        while first > 0 and off[first - 1] > 0.3 * SUDDEN_MM:
            first -= 1
        while last < at.size - 1 and off[last + 1] > 0.3 * SUDDEN_MM:
            last += 1
        if slope[max(first - 2, 0) : last + 3].max() > SUDDEN_SLOPE:
            out[first : last + 1] = np.maximum(out[first : last + 1], off[first : last + 1])
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
    return np.sqrt(tilt), bevel_u, np.sqrt(angle)


def corrected_angles(measured: Measured, s: Float) -> tuple[Float, Float]:
    """Direction of the root face and bevel angle (m,) at s, rad, obliquity taken back."""
    return face_angles(
        measured.faces, s, _along(measured, measured.root_turn, s), _along(measured, measured.bevel_turn, s)
    )


def _along(measured: Measured, value: Float, s: Float) -> Float:
    """What frames (N,) have, at arc lengths s (m,) of the curve."""
    on = np.isfinite(measured.upper_s) & np.isfinite(value)
    order = np.flatnonzero(on)[np.argsort(measured.upper_s[on], kind="stable")]
    return np.interp(s, measured.upper_s[order], value[order])
