"""What a robot may cost the root face, by giving way and by coming back, and what the cutter may ask of its spindle."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Check, Moves, PathGate
from workbench.geometry.poses import rotation_from_quaternion
from workbench.robot.cell_model import Cell
from workbench.units import DEG

DEFLECTION_SHARE, REPEATABILITY_SHARE = 0.5, 0.25  # of the root face's tolerance: what is left is the measurement's
RPM = 2 * np.pi / 60  # rad/s
NO_FORCE = "the cutter's torque and power against the spindle's: the milling force is unknown"
NO_STIFFNESS = "the deflection of the cutter: the robot's stiffness is unknown"


def root_checks(moves: Moves, gate: PathGate, cell: Cell, tolerance_mm: float) -> tuple[Check, ...]:
    """What the final layer's root face owes to the robot, against shares of its tolerance, mm.

    A displacement d of the cutter normal to the bevel face moves the root face's edge by d / sin(bevel). A path that
    was checked as the loaded tool comes (`PathGate.loaded`) allows for it, and an allowance that is milled later takes
    as much.
    """
    path, made = moves.toolpath, moves.postures
    lever = 1.0 / np.sin(path.bevel_deg * DEG)
    checks = []
    if made is not None:
        final = made.cutting & (made.layer == path.layers[-1].index)
        normal = rotation_from_quaternion(made.quaternion_wxyz[final])[:, :, 0]
        moved = np.abs((made.displacement_mm[final] * normal).sum(axis=1))
        value = 0.0 if gate.loaded else float(moved.max(initial=0.0)) * lever
        limit = DEFLECTION_SHARE * tolerance_mm + path.finish_allowance_mm * lever
        why = "half of the root face's tolerance, and the allowance that is left"
        finding = (
            f"the cutter gives way by {value:.3g} mm of the root face, expected at most {limit:.3g}: a stiffer "
            "posture, a smaller depth of cut, or a path that allows for it (stiffness.compensate, then path.check)"
        )
        checks.append(_held("root_deflection_mm", value, limit, why, finding))
    if cell.repeatability_mm is not None:
        value, limit = cell.repeatability_mm * lever, REPEATABILITY_SHARE * tolerance_mm
        finding = (
            f"the robot's repeatability is {value:.3g} mm of the root face, expected at most {limit:.3g}: another "
            "robot, or a wider tolerance (program.write: root_tolerance_mm)"
        )
        checks.append(_held("root_repeatability_mm", value, limit, "a quarter of the root face's tolerance", finding))
    return tuple(checks)


def _held(name: str, value: float, limit: float, why: str, finding: str) -> Check:
    """A value against the most that it may be; what is not known passes."""
    known = round(value, 4) if np.isfinite(value) else None
    return Check(name, known, round(limit, 4), not value > limit, why, finding)


def spindle_checks(moves: Moves, cell: Cell) -> tuple[Check, ...]:
    """Torque and power that the cutter asks, mean of a revolution, against what the spindle gives at its speed (S1).

    Teeth come far faster than the rotor can follow, so a revolution's mean counts. None where the cell states no curve.
    """
    made, curve = moves.postures, cell.spindle
    if made is None or curve is None:
        return ()
    speed = made.spindle_rpm
    torque_nm = float("nan") if made.torque_nm is None else float(made.torque_nm.max(initial=0.0))
    asked = {"torque_nm": torque_nm, "power_kw": torque_nm * speed * RPM / 1000}
    low, high = curve.speed_rpm[0], curve.speed_rpm[-1]
    checks = []
    for name, value in asked.items():
        stated = getattr(curve, name)
        if stated is None:
            continue
        limit = float(np.interp(speed, curve.speed_rpm, stated, left=0.0, right=0.0))
        what, unit = name.split("_")[0], {"torque_nm": "Nm", "power_kw": "kW"}[name]
        why = f"its speed is between {low:g} and {high:g} rpm" if limit == 0 else f"at most {limit:.3g}"
        stays = "what the spindle gives at this speed for any length of time, by its data sheet ($.tool.spindle)"
        finding = (
            f"the cutter asks {what} of {value:.3g} {unit} of the spindle at {speed:g} rpm, expected {why}: a "
            "smaller depth of cut or feed, or another speed (stiffness.force: spindle_rpm)"
        )
        checks.append(_held(f"spindle_{name}", value, limit, stays, finding))
    return tuple(checks)
