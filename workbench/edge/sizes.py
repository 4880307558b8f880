"""Root face and bevel angle along a milled edge, each with its uncertainty by source (docs/method.md, section 5)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.artefacts import DECLARED, DIRECTIONS, END, FORM, HIDDEN, ROUNDING, STEPS, TANGENT, Quantity
from workbench.edge.measure import Measured, face_angles
from workbench.edge.residual_image import FaceForm
from workbench.geometry.along import between
from workbench.units import DEG, Float, Shaped

NEAR_MM = 1.5  # of a section: frames that speak for it


class EndTerms(NamedTuple):
    """What the root face's course leaves open of its end, at m stations."""

    level_u_mm: Shaped[Float, " m"]  # of the levels between which the end steps
    broken_u_mm: Shaped[Float, " m"]  # of what a rounding or a chamfer hides
    hidden_u_mm: Shaped[Float, " m"]  # of columns that never return, or a gap over what the plate lies on
    lower_u_mm: Shaped[Float, " m"]  # of the lower surface at its corner with the root face, by its form; 0: no corner
    declared_u_mm: float
    steep: float  # slope of the root face to the rays' normal


def sizes(
    measured: Measured,
    at: Float,
    tangent_u: Float,
    root_form: FaceForm,
    bevel_form: FaceForm,
    end: EndTerms,
    rocking_u: float,
) -> tuple[Quantity, Quantity]:
    """Root face and bevel angle at arc lengths `at` (m,) of the lower edge.

    tangent_u (m,) rad; root_form, bevel_form: what lasts in the residuals of both faces; rocking_u: of the angle
    between them, by waves of both that are not followed, rad.
    """
    s = at + measured.shift
    tilt_u, bevel_u, angle_u = direction_u(measured, s, root_form.turn_u, bevel_form.turn_u)
    _, beta = corrected_angles(measured, s)
    root = measured.end.course.value(s) + _by_parts(measured, s, beta, root_form, bevel_form)
    of_frames = measured.lever_mm, measured.faces.root.run, measured.faces.bevel.run
    lever, run_root, run_bevel = (between(measured.upper_s, of, s) for of in of_frames)
    leverage = np.sqrt(np.maximum(run_root**2 + run_bevel**2 - 2.0 * run_root * run_bevel * np.cos(beta), 0.0))
    # What obliquity makes of the root face's drift.
    drift_u = np.abs(run_bevel) * np.sin(beta) * measured.end.course.slope_u(s)
    directions = np.hypot(lever / np.sin(beta) * bevel_u, 0.5 * root / np.abs(np.tan(beta)) * tilt_u)
    # The end comes along the rays onto the root face's line, the corner is where both lines cross.
    corner = root_form.upper_u_mm / np.tan(beta), root_form.lower_u_mm * end.steep, bevel_form.lower_u_mm / np.sin(beta)
    root_u = {
        END: measured.end.course.u(s),
        STEPS: end.level_u_mm,
        HIDDEN: end.hidden_u_mm,
        DIRECTIONS: directions,
        TANGENT: tangent_u * np.abs(run_root) * root,
        FORM: np.sqrt(sum(of**2 for of in (*corner, end.lower_u_mm))),
        ROUNDING: end.broken_u_mm,
        DECLARED: np.full(at.size, end.declared_u_mm),
    }
    unseen_mm = np.hypot(end.broken_u_mm, end.hidden_u_mm)
    angle = {
        DIRECTIONS: np.sqrt(angle_u**2 + drift_u**2 + rocking_u**2),
        TANGENT: tangent_u * leverage,
        FORM: np.sqrt(root_form.turn_u**2 + bevel_form.turn_u**2 + (root_form.bowed * unseen_mm) ** 2),
    }
    return (
        Quantity.of("root_mm", root, root_u),
        Quantity.of("bevel_deg", beta / DEG, {name: u / DEG for name, u in angle.items()}),
    )


def straightened(measured: Measured, at: Float, root_form: FaceForm, bevel_form: FaceForm) -> Measured:
    """Without the turns of both faces' lines by parts of them that stand aside; forms at arc lengths `at` (m,)."""
    s = np.nan_to_num(measured.upper_s - measured.shift)
    root, bevel = (
        -lines.facing * np.interp(s, at, form.turn)
        for lines, form in ((measured.faces.root, root_form), (measured.faces.bevel, bevel_form))
    )
    return replace(measured, root_turn=measured.root_turn + root, bevel_turn=measured.bevel_turn + bevel)


def _by_parts(measured: Measured, s: Float, beta: Float, root_form: FaceForm, bevel_form: FaceForm) -> Float:
    """By how much parts of the faces that stand aside make the root face too short (m,) at s, mm."""
    root, bevel = measured.faces.root, measured.faces.bevel
    along = np.cos(root.angle) * root.ray[:, 0] + np.sin(root.angle) * root.ray[:, 1]
    of_frames = root.facing, bevel.facing, along / np.sqrt(1.0 - along**2)
    facing, bevel_facing, lean = (between(measured.upper_s, of, s) for of in of_frames)
    corner = facing * root_form.upper_mm / np.tan(beta) - bevel_facing * bevel_form.lower_mm / np.sin(beta)
    return np.asarray(corner + lean * root_form.lower_mm)


def direction_u(measured: Measured, s: Float, root_form_u: Float, bevel_form_u: Float) -> tuple[Float, Float, Float]:
    """Standard uncertainties (m,) of root face, bevel face and the angle between them at s, rad.

    Beside what the faces' form makes of them (m,), by which passes differ too.
    """
    faces = measured.faces
    bevel_u, apart = faces.bevel_course.u_without(s, bevel_form_u), faces.opening_course.value(s)
    alone = faces.root_course.value(s) - faces.bevel_course.value(s)
    root_u, opening_u = (one.u_without(s, root_form_u) for one in (faces.root_course, faces.opening_course))
    tilt = (1.0 - faces.follows) * root_u**2 + faces.follows * opening_u**2
    angle = tilt + bevel_u**2 + faces.follows * (1.0 - faces.follows) * (alone - apart) ** 2
    return np.sqrt(tilt), bevel_u, np.sqrt(angle)


def corrected_angles(measured: Measured, s: Float) -> tuple[Float, Float]:
    """Direction of the root face and bevel angle (m,) at s, rad, obliquity taken back."""
    turns = (between(measured.upper_s, of, s) for of in (measured.root_turn, measured.bevel_turn))
    return face_angles(measured.faces, s, *turns)
