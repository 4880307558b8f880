"""`stiffness.chatter`: limiting over actual depth of cut along a path."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.api import (
    Cell,
    Chapter,
    Document,
    Float,
    Postures,
    Toolpath,
    pieces,
    plot,
    result_file,
    stage,
)
from workbench.plugins.ranges import LeastMargin, SizeMm, Stations, ToleranceMm
from workbench.plugins.stiffness.margins import JUDGED_MM, cuts_of, judged_limits, screen_limits, u_of_modes
from workbench.plugins.stiffness.milling_choice import Bounds, Chosen, choose, speeds
from workbench.plugins.stiffness.predict_stage import base_from_point
from workbench.plugins.stiffness.values import MillingForce, PathStability, RobotModes


@stage("stiffness.chatter")
def chatter(
    cell: Cell,
    modes: RobotModes,
    toolpath: Toolpath,
    force: MillingForce,
    postures: Postures,
    *,
    stations: Stations = 24,
    largest_depth_mm: SizeMm = JUDGED_MM,
    least_margin: LeastMargin = 1.5,
    force_relative_u: Annotated[float | None, Field(gt=0, le=5)] = None,
    most_layers: Annotated[int, Field(ge=0, le=100)] = 12,
    speed_change: Annotated[float, Field(gt=0, le=0.9)] = 0.25,
    root_tolerance_mm: ToleranceMm = 0.5,
) -> tuple[PathStability, Document, Chapter]:
    """Whether the cut chatters: the least unstable depth over the depth, along the path, with U (docs/stiffness.md).

    For up-milling (as the path runs) and down-milling. Then layers, direction and speed of least time are chosen within
    the margin, the spindle's torque and power and the root face's tolerance: the `choice` in `chatter.json`.

    Args:
        cell: the robot.
        modes: of robot, spindle and cutter.
        toolpath: the path, as planned.
        force: on the cutter along it, with its coefficients, depths and speed.
        postures: how the robot stands along it.
        stations: number of places that cut, evenly spread, that are judged.
        largest_depth_mm: largest depth examined.
        least_margin: least ratio of depths, less U; the page says where it is missed.
        force_relative_u: ratio of standard uncertainty to force coefficients; null: their file's, or the scatter of
            published ones.
        most_layers: largest number of layers to share the depth; 0: nothing is chosen.
        speed_change: largest change of the speed, as a share, with the feed.
        root_tolerance_mm: of the root face, either way; the cutter may deflect by half of it.

    Raises:
        InputError: postures or force are of another path; a force without coefficients; an invalid mass matrix.

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
    whole = cuts_of(toolpath, force, postures.layer, base_from_point(cell, postures, toolpath))
    cuts = whole.spread(stations)
    joints, u_force = postures.joints[cuts.at], cuts.process.coefficients.relative_u
    dynamics = cuts.dynamics(cell.chain, modes, joints)
    up, down = (judged_limits(dynamics, cuts, way, largest_depth_mm) for way in (0, 1))
    coupling = screen_limits(dynamics, cuts, 0, regeneration=False)
    by_modes = np.array([u_of_modes(cell.chain, modes, cuts, joints, way) for way in (0, 1)])
    u_log = np.hypot(by_modes, u_force if force_relative_u is None else force_relative_u)
    along = np.zeros(len(postures.layer))
    along[postures.layer != 0] = np.concatenate([one.arc_length_mm for one in toolpath.layers])
    found = PathStability(
        at=cuts.at,
        layer=postures.layer[cuts.at],
        arc_length_mm=along[cuts.at],
        depth_mm=cuts.axial_mm,
        up_limit_mm=up,
        down_limit_mm=down,
        coupling_limit_mm=np.where(coupling > largest_depth_mm, np.inf, coupling),
        u_log=u_log[0],
        spindle_rpm=cuts.rpm,
        largest_mm=largest_depth_mm,
        warnings=modes.declared,
    )
    cut, there = cuts.only(np.array([found.worst])), dynamics.at(found.worst)
    every = speeds(cuts.rpm, speed_change, cuts.cutter.flutes, there.fastest_hz)
    up, down = (
        np.array([judged_limits(there, replace(cut, rpm=float(rpm)), way, largest_depth_mm)[0] for rpm in every])
        for way in (0, 1)
    )
    lobes = {"spindle_rpm": every, "up_limit_mm": up, "down_limit_mm": down}
    bounds = Bounds(least_margin, u_log, root_tolerance_mm, most_layers, speed_change)
    choice = choose(cell, toolpath, cuts, found.layer, dynamics, bounds) if most_layers else None
    chosen = None if choice is None else _chosen(choice, least_margin)
    file = _document(
        found, force.source, least_margin, {"part": asdict(toolpath.part), "lobes": lobes, "choice": chosen}
    )
    return (
        found,
        file,
        _chapter(found, force.source, least_margin, lobes, "" if chosen is None else f"{chosen['words']}."),
    )


AT_RIGHT: Any = {"xycoords": ("axes fraction", "data"), "ha": "right"}
NOT_INCLUDED = (
    "process damping of a worn or chamfered edge: it raises the limit at low cutting speed, never lowers it",
    "the plate's and its clamps' own swinging: a thin or free plate may halve the limit",
    "run-out, variable pitch and helix, which break the even delay: a factor of up to two, mostly upwards",
    "what a stage before the controller filters, and swings so large that teeth leave the cut",
)


def _document(found: PathStability, source: str, asked: float, more: dict[str, object]) -> Document:
    """`chatter.json`; `more`: part, lobes and choice."""
    columns = {
        "point": found.at,
        "layer": found.layer,
        "arc_length_mm": found.arc_length_mm,
        "depth_mm": found.depth_mm,
        "up_limit_mm": found.up_limit_mm,
        "down_limit_mm": found.down_limit_mm,
        "mode_coupling_alone_mm": found.coupling_limit_mm,
        "margin": found.margin,
        "least_margin": found.least_margin,
        "u_of_logarithm": found.u_log,
    }
    return result_file(
        "chatter.json",
        {
            "part": more["part"],
            "spindle_rpm": found.spindle_rpm,
            "coefficients": source,
            "largest_depth_mm": found.largest_mm,
            "least_margin_asked": asked,
            "worst": found.words,
            "worst_point": int(found.at[found.worst]),
            "points": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
            **more,
            "declared": found.warnings,
            "not_included": NOT_INCLUDED,
        },
    )


def _chosen(choice: Chosen, asked: float) -> dict[str, object]:
    """The fastest option, the best of each direction, and by what faster ones fail."""
    shown = {way: None if one is None else asdict(one) for way, one in choice.best.items()}
    fastest = choice.fastest
    return {
        "words": choice.words(asked),
        "direction": None if fastest is None else fastest.direction,
        "options": shown,
        "faster_ones_that_fail": {way: dict(count) for way, count in choice.faster.items()},
        "planned_time_s": choice.planned_s,
    }


def _chapter(found: PathStability, source: str, asked: float, lobes: dict[str, Float], choice: str) -> Chapter:
    k, short = found.worst, found.least_margin < asked
    summary = (
        f"Chatter: least margin {found.margin[k]:.2f} of depth, {found.least_margin[k]:.2f} less U (k = 2); "
        f"{asked:g} asked for, missed at {short.sum()} of {len(found.at)} places"
    )
    text = (
        pieces.paragraph(f"{found.words}. Spindle {found.spindle_rpm:g} rev/min, {source}.")
        + (pieces.paragraph(choice) if choice else "")
        + pieces.figure_html(
            _picture(found, asked, lobes), "Margin along the path, and limits over the spindle's speed", ""
        )
        + pieces.list_html([f"Declared: {one}" for one in found.warnings])
        + pieces.list_html([f"Not included: {one}" for one in NOT_INCLUDED])
    )
    return Chapter("Chatter", text, summary=summary)


def _picture(found: PathStability, asked: float, every: dict[str, Float]) -> bytes:
    """The margin along the path, with U, and the lobes at the worst place, by their logarithms (SVG)."""
    ceiling, k = found.largest_mm, found.worst
    up, down = (np.log10(np.minimum(one, ceiling) / found.depth_mm) for one in (found.up_limit_mm, found.down_limit_mm))
    expanded = 2.0 * found.u_log / np.log(10.0)
    figure = plot.Figure((10.0, 5.2))
    along, lobes = figure.subplots(2, 1)
    along.fill_between(found.at, up - expanded, up + expanded, color=pieces.PALE)
    along.plot(found.at, up, linewidth=1.4, label="up, as the path runs, ± U")
    along.plot(found.at, down, linewidth=1.1, color=pieces.ORANGE, label="down")
    along.points(found.at[[k]], up[[k]], "o", markersize=6.0)
    along.annotate("worst place", (found.at[k], up[k]), (0.0, 8.0), ha="center", look=plot.ON_WHITE)
    if asked:
        along.axhline(np.log10(asked), color=pieces.PURPLE, linewidth=0.9, dashes=(6.0, 3.0))
        along.annotate("asked for, less U", (1.0, np.log10(asked)), (-2.0, 3.0), **AT_RIGHT)
    along.set(xlabel="point of the path", ylabel="limit / depth")
    for name, colour in (("up", pieces.INK), ("down", pieces.ORANGE)):
        limit = np.log10(np.minimum(every[f"{name}_limit_mm"], ceiling))
        lobes.plot(every["spindle_rpm"], limit, linewidth=1.2, color=colour, label=name)
    lobes.axhline(np.log10(found.depth_mm[k]), color=pieces.GREY, linewidth=0.9)
    lobes.annotate("depth of cut", (1.0, np.log10(found.depth_mm[k])), (-2.0, 3.0), **AT_RIGHT)
    lobes.axvline(found.spindle_rpm, color=pieces.GREY, linewidth=0.6)
    lobes.set(xlabel="spindle speed, rev/min", ylabel="limit at the worst\nplace, mm")
    for axes in (along, lobes):
        low, high = axes.get_ylim()
        at = [np.log10(m) + k for k in range(int(np.floor(low)), int(np.ceil(high))) for m in (1, 2, 5)]
        at = [one for one in at if low <= one <= high]
        axes.set(yticks=(at, [f"{round(10.0**one, 9):g}" for one in at]))
        axes.legend()
    return figure.svg()
