"""`stiffness.chatter`: limiting over actual depth of cut along a path."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.api import (
    AnyArray,
    Cell,
    Chapter,
    ChatterFile,
    Cutter,
    Document,
    Float,
    InputError,
    Int,
    Postures,
    Shaped,
    Toolpath,
    pieces,
    stage,
)
from workbench.plugins.stiffness.dynamics import at_tool
from workbench.plugins.stiffness.predict import base_from_point
from workbench.plugins.stiffness.stability import Dynamics, Milling, limits, milling, screened
from workbench.plugins.stiffness.values import CuttingProcess, MillingForce, PathStability, RobotModes

COVERAGE = 2.0
SAME_MM = 0.05  # radial depths that count as one
STEP = 0.05  # of a logarithm, by which sensitivities are found
SPEEDS, WIDTH = 15, 0.25  # of the lobes: how many, and how far from the speed stated, as a share


@stage("stiffness.chatter")
def chatter(
    cell: Cell,
    modes: RobotModes,
    toolpath: Toolpath,
    force: MillingForce,
    postures: Postures,
    *,
    stations: Annotated[int, Field(ge=2, le=2000)] = 24,
    largest_depth_mm: Annotated[float, Field(gt=0, le=500)] = 100.0,
    least_margin: Annotated[float, Field(ge=0, le=100)] = 1.5,
    force_relative_u: Annotated[float | None, Field(gt=0, le=5)] = None,
) -> tuple[PathStability, Document, Chapter]:
    """Whether the cut chatters: the least unstable depth over the depth, along the path, with U (docs/stiffness.md).

    Mode coupling and regeneration in one model; the spectral radius over a tooth's period decides, for up-milling (as
    the path runs) and down-milling. Writes `chatter.json`.

    Args:
        cell: the robot.
        modes: of robot, spindle and cutter.
        toolpath: the path, as planned.
        force: on the cutter along it, with its coefficients, depths and speed.
        postures: how the robot stands along it.
        stations: number of places that cut, evenly spread, that are judged.
        largest_depth_mm: that is looked at; a limit beyond it is told as none.
        least_margin: ratio of depths, less U, that is asked for; the page says where it is missed.
        force_relative_u: ratio of standard uncertainty to value of the force coefficients; null: that of their file, or
            the scatter of published ones.

    Raises:
        InputError: postures or force are of another path; a force without coefficients; a mass matrix that is none.

    Example:
        >>> from workbench import path, robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> springs = stiffness.read(cell)
        >>> modes, *_ = stiffness.modes(cell, springs, link_masses_kg=[400, 300, 200, 120, 30, 5])
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> force, file = stiffness.force(plan, None, cell)
        >>> at = {"cutter_rotation_deg": (0, 0), "turntable_deg": (0, 0), "whole_map": False}
        >>> postures, *_ = stiffness.posture(cell, springs, plan, force, **at)
        >>> found, file, chapter = stiffness.chatter(cell, modes, plan, force, postures, stations=3)
        >>> found.up_limit_mm.shape, file.name
        ((3,), 'chatter.json')
    """
    if postures.toolpath is not toolpath:
        raise InputError("postures", "expected those of this path, found another path's")
    whole = cuts_of(toolpath, force, postures.layer, base_from_point(cell, postures, toolpath.cutter.diameter_mm / 2))
    cuts = whole.only(np.unique(np.linspace(0, len(whole.at) - 1, stations).astype(int)))
    joints, u_force = postures.joints[cuts.at], cuts.process.coefficients.relative_u
    up, down, coupling = _judged(cell, modes, cuts, joints, largest_depth_mm)
    found = PathStability(
        at=cuts.at,
        layer=postures.layer[cuts.at],
        depth_mm=cuts.axial_mm,
        up_limit_mm=up,
        down_limit_mm=down,
        coupling_limit_mm=coupling,
        u_log=np.hypot(
            u_of_modes(cell, modes, cuts, joints), u_force if force_relative_u is None else force_relative_u
        ),
        spindle_rpm=cuts.rpm,
        warnings=modes.declared,
    )
    worst = int(np.argmin(found.margin))
    lobes = _lobes(cell, modes, cuts.only(np.array([worst])), joints[[worst]], largest_depth_mm)
    page = _Page(found, modes, cuts.process, toolpath, least_margin, largest_depth_mm, lobes, worst)
    return found, Document(ChatterFile.NAME, _document(page)), _chapter(page)


@dataclass(frozen=True, slots=True, eq=False)
class Cuts:
    """The loaded points of a path: how the cutter meets the material there."""

    cutter: Cutter
    process: CuttingProcess
    rpm: float
    at: Shaped[Int, " m"]  # of all postures
    base_from_tool: Shaped[Float, "m 4 4"]  # a point's axes, where the force acts
    force_n: Shaped[Float, "m 3"]  # mean, base axes
    radial_mm: Shaped[Float, " m"]
    axial_mm: Shaped[Float, " m"]

    def only(self, index: AnyArray) -> Cuts:
        """Some of the points."""
        columns = ("at", "base_from_tool", "force_n", "radial_mm", "axial_mm")
        return Cuts(self.cutter, self.process, self.rpm, *(getattr(self, name)[index] for name in columns))

    def milling(self, radial_mm: float, rpm: float | None = None) -> tuple[Milling, Milling]:
        """Up and down, at a radial depth."""
        k = self.process.coefficients
        chip = (k.ktc_n_mm2, k.krc_n_mm2, k.kac_n_mm2)
        speed = self.rpm if rpm is None else rpm
        return milling(chip, self.cutter.flutes, self.cutter.diameter_mm, radial_mm, self.process.helix, speed)

    @property
    def groups(self) -> list[tuple[float, AnyArray]]:
        """Radial depths that occur and the points (bool, m) that have each."""
        rounded = np.maximum(np.round(self.radial_mm / SAME_MM), 1) * SAME_MM
        return [(float(depth), rounded == depth) for depth in np.unique(rounded)]


def cuts_of(toolpath: Toolpath, force: MillingForce, layer: Int, base_from_point: Float) -> Cuts:
    """The points that cut, of all points (n,) of a path by their layers, 0 in travels, at frames (n, 4, 4).

    Raises:
        InputError: the force is of another path, has no coefficients, or nothing is cut.
    """
    if force.process is None:
        raise InputError("milling force", "expected its coefficients and depths, as stiffness.force makes it")
    own = {one.index: one for one in force.layers}
    at: list[AnyArray] = []
    columns: dict[str, list[Float]] = {"mean_n": [], "radial_mm": [], "axial_mm": []}
    for one in toolpath.layers:
        here = np.flatnonzero(layer == one.index)
        if one.index not in own or len(own[one.index].radial_mm) != len(here):
            raise InputError("milling force", "expected that of this path, point by point")
        cut = np.flatnonzero((own[one.index].radial_mm > 0) & (own[one.index].axial_mm > 0))
        at.append(here[cut])
        for name, rows in columns.items():
            rows.append(getattr(own[one.index], name)[cut])
    points = np.concatenate(at)
    if not len(points):
        raise InputError("milling force", "expected points where the cutter is loaded, found none")
    frames, (mean, radial, axial) = base_from_point[points], (np.concatenate(rows) for rows in columns.values())
    push = (frames[:, :3, :3] @ mean[..., None])[..., 0]
    return Cuts(toolpath.cutter, force.process, force.spindle_rpm, points, frames, push, radial, axial)


def _judged(cell: Cell, modes: RobotModes, cuts: Cuts, joints: Float, largest_mm: float) -> Float:
    """Limits (3, m), mm: milling up, down, and by mode coupling alone (up)."""
    dynamics = at_tool(cell.chain, modes, joints, cuts.base_from_tool, cuts.force_n)
    found = np.full((3, len(joints)), np.inf)
    for radial, here in cuts.groups:
        some = Dynamics(*(part[here] for part in dynamics))
        for row, cut in enumerate(cuts.milling(radial)):
            found[row, here] = _limit(some, cut, largest_mm)
        found[2, here] = screened(some, cuts.milling(radial)[0], largest_mm, regeneration=False)
    return found


def u_of_modes(cell: Cell, modes: RobotModes, cuts: Cuts, joints: Float) -> Float:
    """Standard uncertainty (m,) of the logarithm of the limit by masses, stiffness and damping, by the fast screen."""
    values, vectors = np.linalg.eigh(modes.covariance)
    large = values > 1e-12 * max(values.max(), 1e-300)

    def fast(step: Float) -> Float:
        dynamics = at_tool(cell.chain, modes.moved(step), joints, cuts.base_from_tool, cuts.force_n)
        found = np.full(len(joints), np.inf)
        for radial, here in cuts.groups:
            some = Dynamics(*(part[here] for part in dynamics))
            found[here] = np.minimum(*(screened(some, cut, 1e3) for cut in cuts.milling(radial)))
        return np.asarray(np.log(found))

    total = np.zeros(len(joints))
    for value, way in zip(values[large], vectors.T[large], strict=True):
        step = min(np.sqrt(value), STEP) * way
        with np.errstate(invalid="ignore"):
            slope = (fast(step) - fast(-step)) / (2 * np.linalg.norm(step))
        total += value * np.nan_to_num(slope, posinf=0.0, neginf=0.0) ** 2
    return np.sqrt(total)


def _lobes(cell: Cell, modes: RobotModes, cut: Cuts, joints: Float, largest_mm: float) -> Float:
    """Speeds, and limits up and down (3, s), of one point."""
    speeds = cut.rpm * np.linspace(1 - WIDTH, 1 + WIDTH, SPEEDS)
    dynamics = at_tool(cell.chain, modes, joints, cut.base_from_tool, cut.force_n)
    radial = cut.groups[0][0]
    rows = [[rpm, *(_limit(dynamics, one, largest_mm)[0] for one in cut.milling(radial, rpm))] for rpm in speeds]
    return np.array(rows).T


def _limit(dynamics: Dynamics, cut: Milling, largest_mm: float) -> Float:
    """The judge's limits (k,), its search begun well below what the screen says."""
    return limits(dynamics, cut, largest_mm, np.minimum(screened(dynamics, cut, largest_mm) / 4, largest_mm / 30))


NOT_INCLUDED = (
    "process damping of a worn or chamfered edge: it raises the limit at low cutting speed, never lowers it",
    "the plate's and its clamps' own swinging: a thin or free plate may halve the limit",
    "run-out, variable pitch and helix, which break the even delay: a factor of up to two, mostly upwards",
    "what a stage before the controller filters, and swings so large that teeth leave the cut",
)


class _Page(NamedTuple):
    """All that file and chapter tell."""

    found: PathStability
    modes: RobotModes
    process: CuttingProcess
    toolpath: Toolpath
    asked: float
    largest_mm: float
    lobes: Float
    worst: int

    @property
    def words(self) -> str:
        """The worst place in words."""
        k = self.worst
        up, down = (self.shown(one[k]) for one in (self.found.up_limit_mm, self.found.down_limit_mm))
        return (
            f"At the worst place, {self.found.depth_mm[k]:.1f} mm deep: milling up (as the path runs) chatter {up}; "
            f"milling down (the path backwards) {down}"
        )

    def shown(self, limit_mm: float) -> str:
        """A limit in words."""
        return f"from {limit_mm:.2g} mm" if np.isfinite(limit_mm) else f"none up to {self.largest_mm:g} mm"


def _document(page: _Page) -> bytes:
    found = page.found
    return ChatterFile.written(
        {
            "format": "chatter",
            "version": 1,
            "part": asdict(page.toolpath.part),
            "spindle_rpm": found.spindle_rpm,
            "coefficients": page.process.coefficients.source,
            "largest_depth_mm": page.largest_mm,
            "least_margin_asked": page.asked,
            "worst": page.words,
            "worst_point": int(found.at[page.worst]),
            "points": [
                {
                    "point": int(found.at[k]),
                    "layer": int(found.layer[k]),
                    "depth_mm": found.depth_mm[k],
                    "up_limit_mm": _finite(found.up_limit_mm[k]),
                    "down_limit_mm": _finite(found.down_limit_mm[k]),
                    "mode_coupling_alone_mm": _finite(found.coupling_limit_mm[k]),
                    "margin": _finite(found.margin[k]),
                    "least_margin": _finite(found.least_margin[k]),
                    "u_of_logarithm": found.u_log[k],
                }
                for k in range(len(found.at))
            ],
            "lobes": {
                "spindle_rpm": page.lobes[0],
                "up_limit_mm": [_finite(one) for one in page.lobes[1]],
                "down_limit_mm": [_finite(one) for one in page.lobes[2]],
            },
            "declared": list(page.modes.declared),
            "not_included": list(NOT_INCLUDED),
        }
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _chapter(page: _Page) -> Chapter:
    found, k = page.found, page.worst
    short = found.least_margin < page.asked
    summary = (
        f"Chatter: least margin {found.margin[k]:.2f} of depth, {found.least_margin[k]:.2f} less U (k = 2); "
        f"{page.asked:g} asked for, missed at {int(short.sum())} of {len(found.at)} places"
    )
    text = (
        pieces.paragraph(f"{page.words}. Spindle {found.spindle_rpm:g} rev/min, {page.process.coefficients.source}.")
        + pieces.figure_html(_picture(page), "Margin along the path, and limits over the spindle's speed", "")
        + pieces.list_html([f"Declared: {one}" for one in page.modes.declared])
        + pieces.list_html([f"Not included: {one}" for one in NOT_INCLUDED])
    )
    return Chapter("Chatter", text, summary=summary)


def _picture(page: _Page) -> bytes:
    """The margin along the path, with U, and the lobes at the worst place (SVG)."""
    from matplotlib.figure import Figure

    found, ceiling = page.found, page.largest_mm
    up, down = (np.minimum(one, ceiling) / found.depth_mm for one in (found.up_limit_mm, found.down_limit_mm))
    with pieces.styled():
        figure = Figure(figsize=(10, 5.2), layout="constrained")
        along, lobes = figure.subplots(2, 1)
        along.fill_between(found.at, up * np.exp(-2 * found.u_log), up * np.exp(2 * found.u_log), color=pieces.PALE)
        along.plot(found.at, up, lw=1.4, color=pieces.INK, label="up, as the path runs, ± U")
        along.plot(found.at, down, lw=1.1, color=pieces.ORANGE, label="down")
        along.axhline(page.asked, color=pieces.PURPLE, lw=0.9, ls=(0, (6, 3)), label="asked for, less U")
        along.plot(found.at[page.worst], up[page.worst], "*", mfc="white", mec="black", ms=9)
        along.set(xlabel="point of the path", ylabel="limit / depth", yscale="log")
        along.legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        for row, name, colour in ((1, "up", pieces.INK), (2, "down", pieces.ORANGE)):
            lobes.plot(page.lobes[0], np.minimum(page.lobes[row], ceiling), lw=1.2, color=colour, label=name)
        lobes.axhline(found.depth_mm[page.worst], color=pieces.GREY, lw=0.9, label="depth of cut")
        lobes.axvline(found.spindle_rpm, color=pieces.GREY, lw=0.6)
        lobes.set(xlabel="spindle speed, rev/min", ylabel="limit at the worst\nplace, mm", yscale="log")
        lobes.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        return pieces.svg(figure)
