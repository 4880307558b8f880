"""`robot.json`: what a robot's geometry is off, how sure that is, and what the measurements leave open."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.api import DEG, Float, pieces
from workbench.plugins.calibration.arm_errors import ArmErrors

OPEN = 0.5  # u over the prior's, from which a parameter counts as left open
ALIKE = 0.7  # correlation from which two parameters are told to be hard to tell apart


def arm_document(arm: ArmErrors, values: Float, covariance: Float, more: dict[str, Any]) -> dict[str, Any]:
    """The content of robot.json; `more`: what else the stage found."""
    u = np.sqrt(np.diagonal(covariance))
    parameters = [
        {
            "name": name,
            "axis": int(arm.before[k]) + 1,
            ("value_mm" if arm.is_length[k] else "value_deg"): values[k] / (1.0 if arm.is_length[k] else DEG),
            ("u_mm" if arm.is_length[k] else "u_deg"): u[k] / (1.0 if arm.is_length[k] else DEG),
            "determined": bool(u[k] < OPEN * arm.prior[k]),
        }
        for k, name in enumerate(arm.names)
    ]
    return {
        "format": "robot-calibration",
        "version": 1,
        "frame": "base",
        "parameters": parameters,
        "covariance": covariance,  # of their values, mm and rad
        "left_as_built": _left(arm, covariance, u),
        **more,
    }


def _left(arm: ArmErrors, covariance: Float, u: Float) -> list[str]:
    """Which parameters the measurements leave open, and what each cannot be told from."""
    said = []
    for k in np.flatnonzero(u >= OPEN * arm.prior):
        alike = np.abs(covariance[k]) / np.maximum(u * u[k], 1e-300)
        alike[k] = 0.0
        other = int(np.argmax(alike))
        cause = (
            f"it cannot be told from the {arm.names[other]}"
            if alike[other] > ALIKE
            else "what it does, the place of the robot or of what it carries does too"
        )
        share = 100.0 * float(u[k] / arm.prior[k])
        said.append(f"the {arm.names[k]} is left nearly as built (u is {share:.0f} % of the prior): {cause}")
    return said


def arm_html(document: dict[str, Any], said: str) -> str:
    """The report's chapter: the parameters, and what was found, in words."""
    rows = [
        (one["name"], _number(one, "value"), _number(one, "u"), "" if one["determined"] else "nearly as built")
        for one in document["parameters"]
    ]
    verdict = document["verdict"]
    table = pieces.table_html(("Error of the arm", "found", "u", ""), rows) if rows else ""
    return table + pieces.paragraph(f"{said} {verdict[:1].upper() + verdict[1:]}.")


def _number(one: dict[str, Any], name: str) -> str:
    return f"{one[f'{name}_mm']:.3f} mm" if f"{name}_mm" in one else f"{one[f'{name}_deg']:.4f}°"
