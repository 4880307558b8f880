"""Mechanistic milling force over one revolution of a cylindrical end mill (Altintas, Manufacturing Automation, 2012).

In the frame of a path point: x into the material, y along the feed, z along the cutter's axis from shank to tip. A
right-hand cutter turns positively about z, so its teeth meet the finished face first: up-milling, from no chip to the
thickest. Angle phi of a tooth counts from x towards y; it cuts from 0 to acos(1 - a_e / R).
"""

from __future__ import annotations

import numpy as np

from workbench.api import AnyArray, Cutter, Float, kernel
from workbench.plugins.stiffness.coefficients import CuttingCoefficients

STEPS = 360  # of a revolution
SLICES = 40  # of the axial depth


def milling_force(
    coefficients: CuttingCoefficients,
    cutter: Cutter,
    feed_per_tooth_mm: Float,
    radial_mm: Float,
    axial_mm: Float,
    *,
    helix: float = 0.0,
    runout_mm: float = 0.0,
    runout_angle: float = 0.0,
    steps: int = STEPS,
) -> Float:
    """Force on the cutter (k, steps, 3) in N through one revolution, for k engagements.

    On an edge element: F_t = (K_tc h + K_te) db against its motion, F_r = (K_rc h + K_re) db towards the axis,
    F_a = (K_ac h + K_ae) db towards the tip (right-hand helix). The chip h is what the tooth takes beyond the teeth
    before it (Kline and DeVor 1983): the least of m f sin(phi) and the difference in radius to the m-th one back.

    Args:
        coefficients: of material and tool.
        cutter: diameter and flutes.
        feed_per_tooth_mm: (k,)
        radial_mm: (k,) radial depth of cut, 0 to the diameter.
        axial_mm: (k,) axial depth of cut, from the tip.
        helix: angle, rad.
        runout_mm: distance of the cutter's axis from the spindle's.
        runout_angle: of tooth 1 against the runout, rad.
        steps: angles of a revolution.
    """
    pitch = 2 * np.pi / cutter.flutes
    radius = cutter.diameter_mm / 2
    offset = runout_mm * np.cos(runout_angle - pitch * np.arange(cutter.flutes))
    c = coefficients
    table = np.array([[c.ktc_n_mm2, c.kte_n_mm], [c.krc_n_mm2, c.kre_n_mm], [c.kac_n_mm2, c.kae_n_mm]])
    met = np.broadcast_arrays(feed_per_tooth_mm, radial_mm, axial_mm)
    feed, radial, axial = (np.array(part, float).reshape(-1) for part in met)
    return np.asarray(_revolutions(table, offset, radius, float(np.tan(helix)), feed, radial, axial, steps))


@kernel
def _revolutions(
    table: AnyArray,
    offset: AnyArray,
    radius: float,
    lag: float,
    feed: AnyArray,
    radial: AnyArray,
    axial: AnyArray,
    steps: int,
) -> AnyArray:
    force = np.zeros((len(feed), steps, 3))
    for k in range(len(feed)):
        if radial[k] > 0.0 and axial[k] > 0.0:
            last = np.arccos(max(1.0 - radial[k] / radius, -1.0))
            for step in range(steps):
                turned = 2 * np.pi * (step + 0.5) / steps
                _add_teeth(force[k, step], table, offset, radius, lag, feed[k], last, axial[k], turned)
    return force


@kernel
def _add_teeth(
    force: AnyArray,
    table: AnyArray,
    offset: AnyArray,
    radius: float,
    lag: float,
    feed: float,
    last: float,
    axial: float,
    turned: float,
) -> None:
    """Forces of all elements that cut when the first tooth's tip stands at `turned`; helix lags towards the shank."""
    flutes, db = len(offset), axial / SLICES
    for j in range(flutes):
        for i in range(SLICES):
            phi = (turned - 2 * np.pi * j / flutes - lag * (i + 0.5) * db / radius) % (2 * np.pi)
            if phi > last:
                continue
            h = _chip(offset, j, feed * np.sin(phi))
            if h <= 0.0:
                continue
            ft = (table[0, 0] * h + table[0, 1]) * db
            fr = (table[1, 0] * h + table[1, 1]) * db
            force[0] += ft * np.sin(phi) - fr * np.cos(phi)
            force[1] += -ft * np.cos(phi) - fr * np.sin(phi)
            force[2] += (table[2, 0] * h + table[2, 1]) * db


@kernel
def _chip(offset: AnyArray, tooth: int, radial_feed: float) -> float:
    """Chip thickness of a tooth: beyond the surface that the teeth before it left."""
    flutes = len(offset)
    least = np.inf
    for m in range(1, flutes + 1):
        least = min(least, m * radial_feed + offset[tooth] - offset[(tooth - m) % flutes])
    return least
