"""Number of layers, milling direction and spindle speed of least time that keep the margin from chatter.

The chip stays as planned: the feed goes with the speed. The material of all layers is shared by another number of them,
so radial depths change and widths do not; the final layer, whose cut is widest, is always there.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from workbench.api import COVERAGE, DEG, Cell, Float, Int, Shaped, Toolpath
from workbench.plugins.stiffness.elastic import MM
from workbench.plugins.stiffness.force_stage import mean_matrices
from workbench.plugins.stiffness.margins import Cuts, first_limit
from workbench.plugins.stiffness.stability import Dynamics

DIRECTIONS = ("up", "down")  # as the path runs, and backwards
A_LOBE = 8  # speeds across a lobe of the fastest mode
FEWEST, MOST = 15, 61  # speeds that are looked at
SURE = 0.5  # of the margin that is needed: below it the screen's word is taken, above the judge's
SPEEDS = (1.0, 0.97, 1.03)  # of a speed: a lobe that is narrower is not relied on
DEFLECTION_SHARE = 0.5  # of the root face's tolerance, as where programs are written


@dataclass(frozen=True, slots=True)
class Option:
    """A way of milling the edge."""

    layers: int
    direction: str
    spindle_rpm: float
    radial_depth_mm: float  # largest
    time_s: float
    torque_nm: float  # largest, of the spindle
    power_kw: float
    root_deflection_mm: float  # largest in the final layer


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """What an option must keep."""

    margin: float  # limit over depth, less U
    u_log: Shaped[Float, "2 m"]  # of the limits up and down
    root_tolerance_mm: float
    most_layers: int
    speed_change: float  # share of the stated speed


@dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """The option of least time of each direction, and how many that are faster fail by what."""

    best: dict[str, Option | None]
    faster: dict[str, Counter[str]]
    planned_s: float

    @property
    def fastest(self) -> Option | None:
        """Of both directions."""
        return min((one for one in self.best.values() if one), key=lambda one: one.time_s, default=None)

    def words(self, margin: float) -> str:
        """The choice in words."""
        asked, one = f"a margin of {margin:g} less U", self.fastest
        failed = sum(self.faster.values(), Counter[str]()) if one is None else self.faster[one.direction]
        why = ", ".join(f"{what} {count}" for what, count in failed.most_common())
        if one is None:
            return f"No number of layers, direction and speed keeps {asked}; what stands against them: {why}"
        beyond = f"; what stands against faster ones in that direction: {why}" if why else ""
        return (
            f"Least time with {asked}: {one.layers} layers of {one.radial_depth_mm:.2g} mm, milling {one.direction}, "
            f"{one.spindle_rpm:.0f} rev/min, {one.time_s / 60:.1f} min ({self.planned_s / 60:.1f} as planned){beyond}"
        )


def speeds(rpm: float, change: float, flutes: int, fastest_hz: float) -> Float:
    """Spindle speeds about one, so close that no lobe of a mode lies between two of them."""
    lobe = rpm * flutes / (60.0 * fastest_hz)  # its width, as a share of the speed
    count = int(np.clip(np.ceil(2 * change * A_LOBE / (lobe * (1 - change) ** 2)) + 1, FEWEST, MOST)) | 1
    return rpm * np.linspace(1 - change, 1 + change, count)


def choose(
    cell: Cell, toolpath: Toolpath, cuts: Cuts, layer: Shaped[Int, " m"], dynamics: Dynamics, bounds: Bounds
) -> Chosen:
    """Of each direction the option of least time that keeps all bounds, at places (m,) of a path with their layers."""
    planned_s = toolpath.time_s
    count = len(toolpath.layers)
    every = speeds(cuts.rpm, bounds.speed_change, cuts.cutter.flutes, dynamics.fastest_hz)
    best: dict[str, Option | None] = dict.fromkeys(DIRECTIONS)
    faster = {way: Counter[str]() for way in DIRECTIONS}
    pairs = sorted(product(range(1, bounds.most_layers + 1), every), key=lambda pair: (pair[0] / pair[1], pair[0]))
    final = layer == toolpath.layers[-1].index
    give = dynamics.shape @ np.linalg.solve(dynamics.stiffness, dynamics.shape.mT) * MM  # mm/N
    for row, way in enumerate(DIRECTIONS):
        for layers, rpm in pairs:
            met = replace(cuts, rpm=rpm, radial_mm=cuts.radial_mm * count / layers)
            if met.radial_mm.max() > cuts.cutter.diameter_mm:
                faster[way]["a depth beyond the cutter's diameter"] += 1
                continue
            time_s = planned_s * layers / count * cuts.rpm / met.rpm
            option = _option(toolpath, met, row, layers, time_s, np.where(final[:, None], give[:, 0], 0.0))
            fails = _beyond(cell, toolpath, option, bounds)
            needed = bounds.margin * np.exp(COVERAGE * bounds.u_log[row]) * met.axial_mm
            if not fails and np.isfinite(first_limit(dynamics, met, row, needed, SPEEDS, SURE)):
                fails = "chatter"
            if not fails:
                best[way] = option
                break
            faster[way][fails] += 1
    return Chosen(best, faster, planned_s)


def _option(toolpath: Toolpath, met: Cuts, way: int, layers: int, time_s: float, give: Float) -> Option:
    """What an option asks of spindle and robot, which gives way across the bevel face by `give` (m, 3), mm/N."""
    force, torque = np.zeros((len(met.at), 3)), np.zeros(len(met.at))
    for radial, here in met.groups:
        cut, axial = met.milling(radial)[way], met.axial_mm[here]
        mean = mean_matrices(met.cutter, cut.entry, cut.exit, met.chip_mm[here]) @ met.process.coefficients.values
        force[here], torque[here] = axial[:, None] * mean[:, :3], axial * mean[:, 3]
    most, moved = torque.max(), np.abs(np.einsum("mr,mr->m", give, force))
    return Option(
        layers=layers,
        direction=DIRECTIONS[way],
        spindle_rpm=met.rpm,
        radial_depth_mm=met.radial_mm.max(),
        time_s=time_s,
        torque_nm=most,
        power_kw=most * met.rpm * 2 * np.pi / 60 / 1000,
        root_deflection_mm=moved.max() / np.sin(toolpath.bevel_deg * DEG),
    )


def _beyond(cell: Cell, toolpath: Toolpath, option: Option, bounds: Bounds) -> str:
    """Which limit of spindle or deflection an option passes; empty: none."""
    curve = cell.spindle
    for name in () if curve is None else ("torque_nm", "power_kw"):
        stated = getattr(curve, name)
        if stated is not None and curve is not None:
            most = np.interp(option.spindle_rpm, curve.speed_rpm, stated, left=0.0, right=0.0)
            if getattr(option, name) > most:
                return f"the spindle's {name.split('_')[0]}"
    allowance = toolpath.finish_allowance_mm / np.sin(toolpath.bevel_deg * DEG)
    if option.root_deflection_mm > DEFLECTION_SHARE * bounds.root_tolerance_mm + allowance:
        return "deflection"
    return ""
