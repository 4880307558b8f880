"""From the choice to postures: joint angles, displacement, clearance and the turned targets of every point.

And these as a chapter of the report: the map with the choice on it, the robot before and after (Fig. 17).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from workbench.api import (
    DEG,
    Cell,
    Chapter,
    Float,
    Int,
    Postures,
    Shaped,
    Toolpath,
    base_from_targets,
    cell_triangles,
    forward_kinematics,
    inverse,
    pieces,
    posture_key,
    posture_picture,
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

NO_PLATE = "The cell holds no plate (robot.plate): the path alone is drawn."
CLOSE_UP_MM, BESIDE = 220.0, 1.3  # the close-up shows so much at least, and so many times the path


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
        return None if self.bound is None else float(self.cost[self.bound_at].mean() / self.bound.mean() - 1)

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
    every = np.arange(len(joints))
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
        warnings=warnings + _too_fast(cell, joints, points),
        planned_turntable=points.planned,
        on_track=sliding(cell),
        torque_nm=points.torque_nm,
        spindle_rpm=points.spindle_rpm,
    )


def _too_fast(cell: Cell, joints: Float, points: PathPoints) -> tuple[str, ...]:
    """Joints that cannot follow the path's own feed: the controller will slow down there."""
    speed = np.abs(np.diff(joints, axis=0)) / points.time_steps_s[1:, None]
    return tuple(
        f"joint {j} would need {share:.1f} times its largest speed at the path's feed"
        for j, share in enumerate((speed.max(axis=0) / cell.chain.speeds).tolist(), 1)
        if share > 1
    )


def _feeds(points: PathPoints, position_mm: Float) -> Float:
    """Feeds in the base that take as long from point to point as the path's own do on the workpiece."""
    way = np.linalg.norm(np.diff(position_mm, axis=0), axis=1)
    planned = np.linalg.norm(np.diff(points.part_mm, axis=0), axis=1)
    same = np.isclose(way, planned, rtol=1e-9, atol=1e-9) | (planned < 1e-6) | (way < 1e-6)
    ratio = np.where(same, 1.0, way / np.where(same, 1.0, planned))
    return np.append(points.feed_mm_s[:1], points.feed_mm_s[1:] * ratio)


# The report's chapter.


def robots_html(cell: Cell, found: Found) -> str:
    """Before and after, from the same point of view: the cell, and close to the path."""
    made = found.postures
    at = found.points.loaded[len(found.points.loaded) // 2]
    before = found.cases["as planned"]
    views = [] if before is None else [("As planned", before.joints[at], before.external[at])]
    views.append(("As chosen", made.joints[at], made.turntable[at]))
    drawn = []
    for name, joints, table in views:
        turned = found.points.moved(cell, table)
        way = found.points.part_mm[found.points.cutting] @ turned[:3, :3].T + turned[:3, 3]
        bodies = cell_triangles(cell, joints, table)
        size = max(CLOSE_UP_MM, BESIDE * float(np.ptp(way, axis=0).max()))
        drawn.append((posture_picture(cell, bodies, way), name))
        drawn.append((posture_picture(cell, bodies, way, size), f"{name}, close to the path"))
    note = "" if any(shape.body == "workpiece" for shape in cell.shapes) else pieces.paragraph(NO_PLATE)
    return pieces.panels_html(drawn, pairs=True) + pieces.key_html(posture_key(cell)) + note


def posture_chapter(cell: Cell, found: Found, toolpath: Toolpath) -> Chapter:
    """Map, comparison, robot before and after, displacement along the path."""
    made = found.postures
    above = "" if found.gap is None else f", {100 * found.gap:.1f} % above the best posture of each single point"
    beside = "" if found.asked is None else "; beside it the margin from chatter, limit over depth"
    summary = (
        f"Postures for {len(found.points.layer)} points: {mean_of(found)}{above}; least clearance "
        f"{np.nanmin(made.clearance_mm, initial=np.inf):.0f} mm"
    )
    text = (
        pieces.paragraph(pieces.minus(_how(found)))
        + pieces.list_html(made.warnings)
        + _table(found)
        + _causes(found)
        + pieces.heading(f"Mean {found.measure.name} over cutter rotation and turntable angle")
        + pieces.figure_html(
            map_picture(found), f"Map of the mean {found.measure.name}, with the chosen postures{beside}"
        )
        + pieces.heading("The robot at the middle of the path")
        + robots_html(cell, found)
        + pieces.heading(f"{found.measure.name.capitalize()} and margins along the path")
        + pieces.figure_html(along_picture(cell, found), "Cost and margins along the path")
    )
    return Chapter("Postures", text, summary=summary, part=toolpath.part, warnings=made.warnings)


def mean_of(found: Found) -> str:
    """The mean of what was chosen by, in words."""
    if found.measure == DISPLACEMENT:
        return f"mean displacement {found.cost.mean():.4f} mm"
    return f"mean awkwardness {found.cost.mean():.2f} (1 is best; no stiffness is known)"


def _sought(made: Postures) -> Float:
    """Values (n,) of the external axis of the map."""
    return made.turntable if made.turntable.ndim == 1 else made.turntable[:, -1]


def _axis(made: Postures) -> str:
    return "track, mm" if made.on_track else "turntable, °"


def _heads(found: Found) -> tuple[str, str, str]:
    return "Cutter rotation, °", _axis(found.postures).capitalize(), _label(found.measure)


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
    head = ("Posture", *_heads(found), "Largest", "Remark")
    return pieces.table_html(head, rows, text=(5,))


def _row(name: str, case: Case | None) -> tuple[str, ...]:
    if case is None:
        return name, "–", "–", "–", "–", "out of the robot's reach or limits"
    said = f"collision of {case.pair[0]} with {case.pair[1]}" if case.pair else ""
    d = case.cost
    return name, f"{case.rotation / DEG:g}", f"{case.table / DEG:g}", f"{d.mean():.4f}", f"{d.max():.4f}", said


def _causes(found: Found) -> str:
    """Why the rest of the map is infeasible."""
    pair = found.map.pair
    parts = found.map.shares(1, (3, 2, 1, COLLISION))
    pairs = [f"{a} with {b} {100 * np.mean(pair == i):.1f} %" for i, (a, b) in enumerate(found.map.pairs)]
    if not parts:
        return pieces.paragraph("The whole map is feasible.")
    return pieces.paragraph(f"Infeasible share of the map: {', '.join(parts + pairs)}.")


# Pictures of the posture optimiser: its map (Fig. 17a), and what comes along the path.

SHADES = {1: "#9d4edd", 2: "#8d99ae", 3: "#2b2d42", COLLISION: "#d62828"}  # by cause


def map_picture(found: Found) -> bytes:
    """Contours of the mean cost; what is infeasible in the colour of its cause; the choice on top (SVG).

    Beside it, where asked for, those of the margin from chatter, with the line beyond which it is kept less U.
    """
    from matplotlib.figure import Figure

    over, columns = found.map, 1 if found.map.chatter is None else 2
    with pieces.styled():
        figure = Figure(figsize=(10, 5), layout="constrained")
        left, *right = np.ravel(figure.subplots(1, columns))
        _contours(figure, left, found, over.mean, _label(found.measure).lower())
        _mark(left, found)
        if right and over.chatter is not None:
            margin, kept = over.chatter
            finite = np.where(np.isposinf(margin), np.nanmax(margin, where=np.isfinite(margin), initial=1.0), margin)
            _contours(figure, right[0], found, np.log10(finite), "margin from chatter (logarithm to 10)")
            if len(over.tables) > 1:
                at, table = np.nonzero(kept >= (found.asked or 0.0))
                angles = over.rotations[at] / DEG, over.tables[table] / DEG
                right[0].plot(*angles, ".", ms=3, color="white", mec="black", mew=0.3, label="kept less U")
            made, loaded = found.postures, found.points.loaded
            chosen = (made.cutter_rotation[loaded[0]] / DEG, _sought(made)[loaded[0]] / DEG)
            if len(over.tables) > 1:
                right[0].plot(*chosen, "*", mfc="white", mec="black", ms=9, label="chosen")
            else:
                right[0].axvline(chosen[0], color=pieces.PURPLE, lw=0.9, label="chosen")
            right[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
        for c, colour in SHADES.items():
            if (over.cause == c).any():
                left.plot([], [], "s", color=colour, alpha=0.55, label=CAUSES[c])
        left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=8 // columns)
        return pieces.svg(figure)


def _contours(figure: Any, axes: Any, found: Found, values: Float, label: str) -> None:
    """A map's values (t, a) over its angles, and the causes where it has none."""
    from matplotlib.colors import ListedColormap

    over = found.map
    x, y = over.rotations / DEG, over.tables / DEG
    axes.set_xlabel("cutter rotation, °")
    if len(y) == 1:
        axes.plot(x, values[:, 0])
        axes.set_ylabel(label)
        return
    axes.imshow(
        np.ma.masked_equal(over.cause.T, 0),
        cmap=ListedColormap([SHADES[c] for c in range(1, 5)]),
        vmin=1,
        vmax=4,
        extent=(x[0], x[-1], y[0], y[-1]),
        origin="lower",
        aspect="auto",
        alpha=0.55,
        interpolation="nearest",
    )
    drawn = axes.contourf(x, y, values.T, levels=16, cmap="viridis")
    figure.colorbar(drawn, ax=axes, label=label)
    axes.set_ylabel(_axis(found.postures))


def _mark(axes: Any, found: Found) -> None:
    """The choice at each point, and the pairs that it is compared with."""
    made, flat = found.postures, len(found.map.tables) == 1
    loaded = found.points.loaded
    height = found.cost if flat else _sought(made)[loaded] / DEG
    axes.plot(made.cutter_rotation[loaded] / DEG, height, ".", color=pieces.PURPLE, ms=4, label="chosen, at each point")
    for (name, case), mark in zip(found.cases.items(), ("D", "v", "*"), strict=True):
        if case is not None:
            at = case.cost.mean() if flat else case.table / DEG
            axes.plot(case.rotation / DEG, at, mark, mfc="white", mec="black", ms=9, label=name)


def along_picture(cell: Cell, found: Found) -> bytes:
    """Displacement of the loaded points, clearance and distance from limits, in the order of motion (SVG)."""
    from matplotlib.figure import Figure

    made, loaded = found.postures, found.points.loaded
    low, high = cell.chain.limits.T
    room = np.minimum(made.joints - low, high - made.joints).min(axis=1)[loaded] / DEG
    kept = [
        ("clearance,\nmm", made.clearance_mm[loaded], cell.margin_mm),
        ("to a joint\nlimit, °", room, cell.margins.limit / DEG),
    ]
    kept = [row for row in kept if np.isfinite(row[1]).any()]
    rows = len(kept)
    with pieces.styled():
        figure = Figure(figsize=(10, 3.4 + 1.2 * rows), layout="constrained")
        top, *others = np.ravel(figure.subplots(1 + rows, 1, sharex=True, height_ratios=(2, *[1] * rows)))
        for name, case in found.cases.items():
            if case is not None:
                chosen = {"color": pieces.INK, "lw": 1.4, "label": "as chosen"}
                top.plot(case.cost, **(chosen if name == "best" else {"lw": 1, "label": name}))
        if found.bound is not None:
            top.plot(found.bound_at, found.bound, color=pieces.INK, ls=":", lw=1, label="best of each single point")
        top.set_ylabel(f"{found.measure.name}{found.measure.unit}".replace(" ", "\n"))
        top.set_ylim(0, top.get_ylim()[1])
        top.legend(ncols=5, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        for axes, (name, values, limit) in zip(others, kept, strict=True):
            axes.plot(values, lw=1.1)
            axes.axhline(limit, color=pieces.PURPLE, lw=0.9, ls=(0, (6, 3)), label="required")
            axes.set_ylim(0, 1.08 * max(float(np.nanmax(values)), limit))
            axes.set_ylabel(name)
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        [top, *others][-1].set_xlabel("points that cut, in the order of motion")
        figure.align_ylabels()
        return pieces.svg(figure)
