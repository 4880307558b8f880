"""From the choice to postures: joint angles, displacement, clearance and the turned targets of every point.

And these as a chapter of the report: the map with the choice on it, the robot before and after (Fig. 17).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np

from workbench.api import (
    DEG,
    Cell,
    Chapter,
    Float,
    Int,
    Postures,
    Scene,
    Shaped,
    Strokes,
    Toolpath,
    base_from_targets,
    cell_strokes,
    chords_mm,
    forward_kinematics,
    inverse,
    mapped,
    pieces,
    plot,
    quaternion_from_rotation,
    sliding,
)
from workbench.plugins.stiffness.arm import FREE
from workbench.plugins.stiffness.path_points import PathPoints
from workbench.plugins.stiffness.traversal import (
    CAUSES,
    COLLISION,
    CONFIGURATIONS,
    Choice,
    Examiner,
    PostureMap,
)

AZIMUTH, ELEVATION = -60.0 * DEG, 22.0 * DEG  # from where a still picture shows the cell
FEASIBLE = "The whole map is feasible."
NO_PLATE = "The cell holds no plate (robot.plate): the path alone is drawn."


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A constant pair of angles that the choice is compared with."""

    rotation: float
    table: float
    external: Shaped[Float, "n ..."]  # of the axes
    joints: Shaped[Float, "n 6"]
    cost: Shaped[Float, " l"]  # of the loaded points, in the found's measure
    cause: int  # index into `traversal.CAUSES`: free or in collision
    pair: tuple[str, str] | None  # that collides


class Measure(NamedTuple):
    """What postures are chosen by."""

    name: str
    unit: str  # with what stands before it


DISPLACEMENT, AWKWARDNESS = Measure("displacement", ", mm"), Measure("awkwardness", "")


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """All that the posture optimiser found, for its file and its chapter."""

    postures: Postures
    points: PathPoints
    choice: Choice  # the constant pair
    map: PostureMap
    measure: Measure
    words: Sequence[tuple[str, ...]]  # what each configuration is called
    bound: Shaped[Float, " s"] | None  # least displacement over the grid of each sampled loaded point, collision aside
    bound_at: Shaped[Int, " s"]  # which of the loaded points they are
    cases: Mapping[str, Case | None]  # as planned, worst; None: the robot cannot do it; and best, as chosen
    asked: float | None = None  # margin from chatter, less U; None: no modes are known

    @property
    def cost(self) -> Shaped[Float, " l"]:
        """Of the loaded points as chosen."""
        best = self.cases["best"]
        assert best is not None
        return best.cost

    @property
    def gap(self) -> float | None:
        """How far the choice is above the point-wise bound, as a share of it."""
        return None if self.bound is None else (self.cost[self.bound_at].mean() / self.bound.mean() - 1)

    @property
    def configuration(self) -> tuple[str, ...]:
        """Of the choice."""
        return self.words[self.choice.configuration]


def case_of(examiner: Examiner, rotation: float, table: float, joints: Float, cause: int = FREE, hit: int = -1) -> Case:
    """A pair of angles with the joints (n, 6) at all points, and what stands in the way."""
    loaded, tables = examiner.points.loaded, np.full(len(joints), table)
    external = examiner.points.external(tables, np.arange(len(joints)))
    cost = examiner.cost(joints[loaded], tables[loaded], loaded)
    pair = examiner.screen.pair(hit) if cause == COLLISION else None
    return Case(rotation, table, external, joints, cost, cause, pair)


def case_at(examiner: Examiner, rotation: float, table: float) -> Case | None:
    """The best of the configurations for a constant pair of angles; in collision where none is free."""
    ways = (examiner.along(which, rotation, table) for which in range(CONFIGURATIONS))
    found = [case_of(examiner, rotation, table, *way) for way in ways if way[1] in (FREE, COLLISION)]
    return min(found, key=lambda case: (case.cause, case.cost.mean()), default=None)


def postures(examiner: Examiner, toolpath: Toolpath, choice: Choice, warnings: tuple[str, ...]) -> Postures:
    """The postures of a choice."""
    cell, points, joints = examiner.cell, examiner.points, choice.joints
    flange_from_point = cell.flange_from_cutter @ inverse(points.point_from_tip)
    every, speed = np.arange(len(joints)), np.abs(np.diff(joints, axis=0)) / points.time_steps_s[1:, None]
    too_fast = tuple(  # the controller will slow down there
        f"joint {j} would need {share:.1f} times its largest speed at the path's feed"
        for j, share in enumerate((speed.max(axis=0) / cell.chain.speeds).tolist(), 1)
        if share > 1
    )
    tables = np.full(len(joints), choice.table)
    table = points.external(tables, every)
    targets = inverse(base_from_targets(cell, table)) @ forward_kinematics(cell.chain, joints) @ flange_from_point
    return Postures(
        toolpath=toolpath,
        layer=points.layer,
        cutting=points.cutting,
        measured=points.measured,
        position_mm=targets[:, :3, 3],
        quaternion_wxyz=quaternion_from_rotation(targets[:, :3, :3]),
        feed_mm_s=_feeds(points, targets[:, :3, 3]),
        cutter_rotation=np.full(len(joints), choice.rotation),
        turntable=table,
        joints=joints,
        displacement_mm=examiner.moved_mm(joints, tables, every),
        clearance_mm=examiner.screen.clearances_mm(joints, table),
        flange_from_point=flange_from_point,
        has_turntable=cell.turntable is not None,
        warnings=warnings + too_fast,
        planned_turntable=points.planned,
        on_track=sliding(cell),
        torque_nm=points.torque_nm,
        spindle_rpm=points.spindle_rpm,
    )


def _feeds(points: PathPoints, position_mm: Float) -> Float:
    """Feeds in the base that take as long from point to point as the path's own do on the workpiece."""
    way = chords_mm(position_mm)
    planned = chords_mm(points.part_mm)
    same = np.isclose(way, planned, rtol=1e-9, atol=1e-9) | (planned < 1e-6) | (way < 1e-6)
    ratio = np.where(same, 1.0, way / np.where(same, 1.0, planned))
    return np.append(points.feed_mm_s[:1], points.feed_mm_s[1:] * ratio)


# The report's chapter.


def robots(cell: Cell, found: Found) -> dict[str, list[Strokes]]:
    """The robot at the middle of the path, and the path, in the base: as chosen; as planned is not shown at first."""
    made, points, before = found.postures, found.points, found.cases["as planned"]
    at = points.loaded[len(points.loaded) // 2]
    views = {"as chosen": (made.joints[at], made.turntable[at])}
    views |= {} if before is None else {"as planned": (before.joints[at], before.external[at])}
    return {
        when: cell_strokes(
            cell,
            joints,
            table,
            f", {when}",
            mapped(points.moved(cell, table), points.part_mm[points.cutting]),
            shown=k == 0,
        )
        for k, (when, (joints, table)) in enumerate(views.items())
    }


def still(strokes: Iterable[Strokes]) -> bytes:
    """Edges of bodies from the right and above, for paper, on which nothing turns (SVG)."""
    (sine, cosine), (rise, flat) = ((math.sin(angle), math.cos(angle)) for angle in (AZIMUTH, ELEVATION))
    right, up = np.array([-sine, cosine, 0.0]), np.array([-rise * cosine, -rise * sine, flat])
    figure = plot.Figure((5.0, 4.6))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(aspect="equal", xticks=([], []), yticks=([], []))
    for one in strokes:
        for line, colours in zip(one.lines_mm, one.colours, strict=True):
            axes.plot(line @ right, line @ up, color="#{:02x}{:02x}{:02x}".format(*colours[0]), linewidth=0.7)
    return figure.svg()


def posture_chapter(cell: Cell, found: Found, toolpath: Toolpath) -> Chapter:
    """Map, comparison, robot before and after, displacement along the path."""
    made, shown = found.postures, robots(cell, found)
    above = "" if found.gap is None else f", {100 * found.gap:.1f} % above the best posture of each single point"
    margin_words = "" if found.asked is None else "; beside it the margin from chatter, limit over depth"
    summary = (
        f"Postures for {len(found.points.layer)} points: {mean_of(found)}{above}; least clearance "
        f"{np.nanmin(made.clearance_mm, initial=np.inf):.0f} mm"
    )
    parts = found.map.shares(1, (3, 2, 1, COLLISION))
    pairs = [f"{a} with {b} {100 * np.mean(found.map.pair == i):.1f} %" for i, (a, b) in enumerate(found.map.pairs)]
    text = (
        pieces.paragraph(pieces.minus(_how(found)))
        + pieces.list_html(made.warnings)
        + _table(found)
        + pieces.paragraph(f"Infeasible share of the map: {', '.join(parts + pairs)}." if parts else FEASIBLE)
        + pieces.heading(f"Mean {found.measure.name} over cutter rotation and turntable angle")
        + pieces.figure_html(
            map_picture(found),
            f"Map of the mean {found.measure.name}, with the chosen postures{margin_words}",
            "",
            ((SHADES[c], CAUSES[c] or "") for c in range(1, len(SHADES)) if (found.map.cause == c).any()),
        )
        + pieces.heading("The robot at the middle of the path")
        + pieces.SPACE
        + pieces.panels_html([(still(strokes), when.capitalize()) for when, strokes in shown.items()], pairs=True)
        + ("" if any(shape.body == "workpiece" for shape in cell.shapes) else pieces.paragraph(NO_PLATE))
        + pieces.heading(f"{found.measure.name.capitalize()} and margins along the path")
        + pieces.figure_html(along_picture(cell, found), "Cost and margins along the path")
    )
    scene = Scene(np.zeros((0, 3)), (), tuple(chain(*shown.values())), (), np.eye(3), axes_names=("x", "y", "z"))
    return Chapter("Postures", text, summary=summary, part=toolpath.part, warnings=made.warnings, scene=scene)


def mean_of(found: Found) -> str:
    """The mean of what was chosen by, in words."""
    if found.measure == DISPLACEMENT:
        return f"mean displacement {found.cost.mean():.4f} mm"
    return f"mean awkwardness {found.cost.mean():.2f} (1 is best; no stiffness is known)"


def _axis(made: Postures) -> str:
    return "track, mm" if made.on_track else "turntable, °"


def _label(measure: Measure) -> str:
    return f"Mean {measure.name}{measure.unit}"


def _how(found: Found) -> str:
    choice, over, made = found.choice, found.map, found.postures
    name, unit = ("the track's place", " mm") if made.on_track else ("turntable angle", "°")
    line = (
        f"Of {choice.of} pairs of cutter rotation and {name}, {choice.rotation / DEG:g}° and "
        f"{choice.table / DEG:g}{unit} ({', '.join(found.configuration).replace('_', ' ')}) give the least mean "
        f"{found.measure.name}; every better pair was examined and excluded. The map shows {over.mean.size} of them."
    )
    if made.on_track and np.ptp(made.turntable) > 0:
        low, high = made.turntable.min() / DEG, made.turntable.max() / DEG
        line += (
            f" The track goes along with the tool, between {low:.0f} and {high:.0f} mm; its place is that at the start."
        )
    if made.turntable.ndim > 1:
        tilt = made.turntable[:, 0] / DEG
        line += f" The turntable is tilted by {tilt.min():g}°" + (f" to {tilt.max():g}°." if np.ptp(tilt) else ".")
    return line


def _table(found: Found) -> str:
    """The choice beside what it is compared with."""
    rows = [_row(name, case) for name, case in found.cases.items()]
    solved = found.map.without_collision
    at = np.unravel_index(np.nanargmin(solved), solved.shape)
    angles = (f"{angle / DEG:g}" for angle in (found.map.rotations[at[0]], found.map.tables[at[1]]))
    rows.append(("best, without the collision check", *angles, f"{solved[at]:.4f}", "–", ""))
    names = "Cutter rotation, °", _axis(found.postures).capitalize(), _label(found.measure)
    head = ("Posture", *names, "Largest", "Remark")
    return pieces.table_html(head, rows, text=(5,))


def _row(name: str, case: Case | None) -> tuple[str, ...]:
    if case is None:
        return name, "–", "–", "–", "–", "out of the robot's reach or limits"
    said = f"collision of {case.pair[0]} with {case.pair[1]}" if case.pair else ""
    d = case.cost
    return name, f"{case.rotation / DEG:g}", f"{case.table / DEG:g}", f"{d.mean():.4f}", f"{d.max():.4f}", said


# Pictures of the posture optimiser: its map (Fig. 17a), and what comes along the path.

SHADES = ("#ffffff", "#9d4edd", "#8d99ae", "#2b2d42", "#d62828")  # by cause


def map_picture(found: Found) -> bytes:
    """Mean cost by colour; what is infeasible in the colour of its cause; the choice on top (SVG).

    Beside it, where asked for, the margin from chatter, with dots where it is kept less U.
    """
    over, asked = found.map, found.asked or 0.0
    fields = [(_label(found.measure), over.mean)]
    if over.chatter is not None:
        margin = over.chatter[0]
        most = np.nanmax(margin, where=np.isfinite(margin), initial=1.0)
        fields.append(("Margin from chatter, logarithm to 10; dots: kept less U", np.log10(np.minimum(margin, most))))
    x, y = over.rotations / DEG, over.tables / DEG
    figure = plot.Figure((10.0, 4.6))
    every = figure.subplots(1, len(fields))
    for axes, (label, values) in zip(every, fields, strict=True):
        axes.set(title=label)
        if len(y) == 1:
            axes.plot(x, values[:, 0])
            axes.set(xlabel="cutter rotation, °")
            continue
        axes.heat(values.T, x, y, [[SHADES[cause] for cause in row] for row in over.cause.T])
        ticks = plot.nice_ticks(axes.get_xlim(), 6)
        axes.set(xlabel="cutter rotation, °", xticks=ticks, ylabel=_axis(found.postures))
        if values is not over.mean and over.chatter is not None:
            at, table = np.nonzero(over.chatter[1] >= asked)
            axes.points(x[at], y[table], "o", color="#ffffff", markersize=1.6)
    _mark(every, found, flat=len(y) == 1)
    return figure.svg()


def _mark(every: Sequence[plot.Axes], found: Found, *, flat: bool) -> None:
    """The choice, and the pairs that it is compared with; on the margin's map the choice alone."""
    for axes in every[:1] if flat else every:
        labels: dict[tuple[float, float], list[str]] = {}
        for name, case in found.cases.items():
            if case is not None and (axes is every[0] or name == "best"):
                at = case.rotation / DEG, case.cost.mean() if flat else case.table / DEG
                labels.setdefault(at, []).append(name)
        for at, names in labels.items():
            for colour, size in ((pieces.INK, 7.0), ("#ffffff", 5.0)):
                axes.points(*at, "o", color=colour, markersize=size)
            axes.annotate(", ".join(names), at, (6.0, -3.0), look=plot.ON_WHITE)


def along_picture(cell: Cell, found: Found) -> bytes:
    """Displacement of the loaded points, clearance and distance from limits, in the order of motion (SVG)."""
    made, loaded = found.postures, found.points.loaded
    low, high = cell.chain.limits.T
    room = np.minimum(made.joints - low, high - made.joints).min(axis=1)[loaded] / DEG
    kept = [
        ("clearance,\nmm", made.clearance_mm[loaded], cell.margin_mm),
        ("to a joint\nlimit, °", room, cell.margins.limit / DEG),
    ]
    kept = [row for row in kept if np.isfinite(row[1]).any()]
    figure, order = plot.Figure((10.0, 3.0 + 1.3 * len(kept))), np.arange(len(loaded))
    top, *others = figure.subplots(1 + len(kept), 1, sharex=True, height_ratios=(2, *[1] * len(kept)))
    drawn = [(name, case.cost) for name, case in found.cases.items() if case is not None and name != "best"]
    for (name, cost), colour in zip([*drawn, ("as chosen", found.cost)], pieces.SERIES, strict=False):
        top.plot(order, cost, color=pieces.INK if name == "as chosen" else colour, linewidth=1.2, label=name)
    if found.bound is not None:
        top.plot(found.bound_at, found.bound, linewidth=1.0, dashes=(1.0, 2.0), label="best of each single point")
    top.set(ylabel=f"{found.measure.name}{found.measure.unit}".replace(" ", "\n"), ylim=(0.0, None))
    top.legend()
    for axes, (name, values, limit) in zip(others, kept, strict=True):
        axes.plot(order, values, color=pieces.BLUE, linewidth=1.1)
        axes.axhline(limit, color=pieces.PURPLE, linewidth=0.9, dashes=(6.0, 3.0))
        axes.annotate("required", (1.0, limit), (-2.0, 3.0), xycoords=("axes fraction", "data"), ha="right")
        axes.set(ylabel=name, ylim=(0.0, 1.08 * max(np.nanmax(values), limit)))
    [top, *others][-1].set(xlabel="points that cut, in the order of motion")
    return figure.svg()
