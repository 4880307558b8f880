"""Root size and bevel angle along a milled edge, each with its uncertainty by source (docs/method.md, section 5)."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import DIRECTIONS, END, TANGENT, Quantity
from workbench.edge.measure import Measured, face_angles
from workbench.units import Float


def sizes(measured: Measured, at: Float, tangent_u: Float) -> tuple[Quantity, Quantity]:
    """Root size (mm) and bevel angle (rad) at arc lengths `at` (m,) of the lower edge; tangent_u (m,) rad."""
    s = at + measured.shift
    tilt_u, bevel_u, angle_u = direction_u(measured, s)
    _, beta = corrected_angles(measured, s)
    root = measured.end.course.value(s)
    lever = _along(measured, measured.lever_mm, s)
    run_root, run_bevel = _along(measured, measured.faces.root.run, s), _along(measured, measured.faces.bevel.run, s)
    leverage = np.sqrt(np.maximum(run_root**2 + run_bevel**2 - 2.0 * run_root * run_bevel * np.cos(beta), 0.0))
    drift_u = (
        np.abs(run_bevel) * np.sin(beta) * measured.end.course.slope_u(s)
    )  # what obliquity makes of the root's drift
    turned = np.hypot(lever / np.sin(beta) * bevel_u, 0.5 * root / np.abs(np.tan(beta)) * tilt_u)
    return (
        Quantity(
            root, {END: measured.end.course.u(s), DIRECTIONS: turned, TANGENT: tangent_u * np.abs(run_root) * root}
        ),
        Quantity(beta, {DIRECTIONS: np.hypot(angle_u, drift_u), TANGENT: tangent_u * leverage}),
    )


def direction_u(measured: Measured, s: Float) -> tuple[Float, Float, Float]:
    """Standard uncertainties (m,) of root face, bevel face and the angle between them at s, rad."""
    faces = measured.faces
    bevel_u, apart = faces.bevel_course.u(s), faces.opening_course.value(s)
    alone = faces.root_course.value(s) - faces.bevel_course.value(s)
    mean = (1.0 - faces.follows) * alone + faces.follows * apart
    angle = (1.0 - faces.follows) * (faces.root_course.u(s) ** 2 + bevel_u**2 + (alone - mean) ** 2)
    angle += faces.follows * (faces.opening_course.u(s) ** 2 + (apart - mean) ** 2)
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
