"""`stiffness.maps`: dexterity and the weight of K_c over two axes (the paper's Figs. 9, 10, 16)."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.api import DEG, Cell, Chapter, Float, InputError, abb_angles, jacobian, pieces, plot, stage
from workbench.plugins.stiffness.elastic import PER_M, give_way
from workbench.plugins.stiffness.values import TABLE_A1_DEG, JointStiffness, Six, StiffnessMaps

Axis = Annotated[int, Field(ge=1, le=6)]
Range = tuple[float, float]
NEGLIGIBLE_FP, NEGLIGIBLE_FR = 0.01, 1e-4  # the paper's section 5.2; the second in rad


@stage("stiffness.maps")
def maps(
    cell: Cell,
    stiffness: JointStiffness,
    *,
    axes: tuple[Axis, Axis] = (2, 3),
    joints_deg: Six = (0, 0, 0, 45, -45, 225),
    ranges_deg: tuple[Range, Range] | None = None,
    postures_deg: list[Six] | None = None,
    force_n: Annotated[float, Field(gt=0, le=1e6)] = 2000.0,
    torque_nm: Annotated[float, Field(gt=0, le=1e6)] = 200.0,
    steps: Annotated[int, Field(ge=5, le=400)] = 41,
    directions: Annotated[int, Field(ge=6, le=2000)] = 60,
) -> tuple[StiffnessMaps, Chapter]:
    """Map 1/omega (18), f_p (19) and f_r (20) over two axes: is K_c negligible for this robot?

    f_p: distance of the cutter's resting places with K_c and without, over the larger displacement (the paper compares
    lengths: its f_p is smaller); f_r: the largest component of the difference in rotation; both worst over directions.

    Args:
        cell: the robot and its tool.
        stiffness: of the joints.
        axes: index of the two axes that are varied, from 1.
        joints_deg: where the other axes stand.
        ranges_deg: of the two axes; null: the robot's limits, within a turn.
        postures_deg: postures to mark, and to judge K_c at; null: the paper's Table A1.
        force_n: size of the force.
        torque_nm: size of the torque, for f_r.
        steps: count of grid points along each axis.
        directions: count of load directions, of which the worst.

    Raises:
        InputError: the two axes are one, or a range is empty.

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> [type(one).__name__ for one in stiffness.maps(cell, stiffness.read(cell))]
        ['StiffnessMaps', 'Chapter']
    """
    a, b = axes[0] - 1, axes[1] - 1
    if a == b:
        raise InputError("stiffness.maps.axes", f"expected two different axes, found {axes[0]} twice")
    spans = np.clip(cell.chain.limits, -np.pi, np.pi)[[a, b]] if ranges_deg is None else np.array(ranges_deg) * DEG
    if (spans[:, 0] >= spans[:, 1]).any():
        raise InputError("stiffness.maps.ranges_deg", "expected the lower angle first in each range")
    at_a, at_b = np.linspace(spans[0, 0], spans[0, 1], steps), np.linspace(spans[1, 0], spans[1, 1], steps)
    grid = np.broadcast_to(np.array(joints_deg, float) * DEG, (steps, steps, 6)).copy()
    grid[..., a], grid[..., b] = np.meshgrid(at_a, at_b, indexing="ij")
    marked = abb_angles(np.array(TABLE_A1_DEG, float) * DEG, "dh")
    if postures_deg is not None:
        marked = np.array(postures_deg, float).reshape(-1, 6) * DEG
    u = sphere(directions)
    across = np.cross(u, np.roll(u, 1, axis=1))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    torques = [u, -u, across, np.cross(u, across)]
    force = np.hstack([u * force_n, np.zeros_like(u)])
    loads = force, np.vstack([np.hstack([u * force_n, v * torque_nm]) for v in torques])
    fields = [np.array(field) for field in zip(*(_row(cell, stiffness, row, loads) for row in grid), strict=True)]
    of_marked = _row(cell, stiffness, marked, loads)
    found = StiffnessMaps(
        axes=axes,
        at=(at_a, at_b),
        inverse_dexterity=fields[0],
        fp=fields[1],
        fr=fields[2],
        marked=marked,
        marked_values=np.array(of_marked).T,
        verdict=_verdict(fields[1], fields[2], of_marked, force_n, torque_nm),
    )
    return found, maps_chapter(found)


def _row(
    cell: Cell, stiffness: JointStiffness, joints: Float, loads: tuple[Float, Float]
) -> tuple[Float, Float, Float]:
    """1/omega (n,), f_p (n,) and f_r (n,) at postures (n, 6), under forces alone (m, 6) and with torques (M, 6)."""
    tip = cell.flange_from_cutter[:3, 3]
    j = jacobian(cell.chain, joints, tip) / PER_M[:, None]
    omega = np.abs(np.linalg.det(j))
    k = stiffness.nm_per_rad
    (force, force_alone), (both, both_alone) = (
        [give_way(cell.chain, k, joints[:, None], tip, each, with_kc=kc)[0] for kc in (True, False)] for each in loads
    )
    size = np.maximum(*(np.linalg.norm(one[..., :3], axis=-1) for one in (force, force_alone)))
    fp = np.linalg.norm((force - force_alone)[..., :3], axis=-1) / size
    fr = np.abs(both - both_alone)[..., 3:].max(axis=-1)
    with np.errstate(divide="ignore"):
        return 1 / omega, fp.max(axis=1), fr.max(axis=1)


def sphere(count: int) -> Float:
    """`count` unit vectors (count, 3), evenly spread (Fibonacci lattice)."""
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def _verdict(fp: Float, fr: Float, marked: tuple[Float, Float, Float], force_n: float, torque_nm: float) -> str:
    """The paper's claim for this robot, in one line."""
    share = np.mean((fp < NEGLIGIBLE_FP) & (fr < NEGLIGIBLE_FR))
    whole = "everywhere on the map" if share == 1 else f"on {100 * share:.0f} % of the map only"
    line = (
        f"K_c is negligible (f_p < {NEGLIGIBLE_FP:g}, f_r < {NEGLIGIBLE_FR:g} rad at {force_n:g} N, {torque_nm:g} Nm) "
        f"{whole}: f_p up to {fp.max():.3g}, f_r up to {fr.max():.2g} rad"
    )
    if len(marked[1]):
        line += f"; at the marked postures f_p up to {marked[1].max():.2g}, f_r up to {marked[2].max():.2g} rad"
    return line


# The maps of dexterity and K_c as a chapter of the report.


def maps_chapter(maps: StiffnessMaps) -> Chapter:
    """Three contour maps with the marked postures, and the verdict on K_c."""
    fields = (
        ("1/ω, 1/m³ (log₁₀)", np.log10(maps.inverse_dexterity)),
        ("f_p, worst direction", maps.fp),
        ("f_r, worst direction, µrad", 1e6 * maps.fr),
    )
    rows = [
        (f"{i}", ", ".join(f"{v:.1f}" for v in q / DEG), f"{w:.3f}", f"{fp:.4f}", f"{fr:.2e}")
        for i, (q, (w, fp, fr)) in enumerate(zip(maps.marked, maps.marked_values, strict=True), 1)
    ]
    text = (
        pieces.paragraph(f"{maps.verdict}.")
        + pieces.figure_html(
            _picture(maps, fields),
            f"Maps of 1/ω, f_p and f_r over axes {maps.axes[0]} and {maps.axes[1]}",
            "Circles: the marked postures.",
        )
        + (pieces.table_html(("Posture", "Joints, °", "1/ω, 1/m³", "f_p", "f_r, rad"), rows) if rows else "")
    )
    return Chapter("Stiffness over the workspace", text, summary=maps.verdict)


def _picture(maps: StiffnessMaps, fields: tuple[tuple[str, Float], ...]) -> bytes:
    """The maps side by side (SVG); what is beyond 98 % of a field has the colour of that."""
    at = [values / DEG for values in maps.at]
    marked = maps.marked[:, [axis - 1 for axis in maps.axes]] / DEG
    figure = plot.Figure((10.0, 3.4))
    every = figure.subplots(1, len(fields), sharey=True)
    for axes, (title, values) in zip(every, fields, strict=True):
        shown = np.where(np.isfinite(values), values, np.nan)
        shown = np.minimum(shown, np.nanpercentile(shown, 98))
        axes.heat(shown.T, *at)
        for colour, size in ((pieces.INK, 5.0), ("#ffffff", 3.5)):
            axes.points(*marked.T, "o", color=colour, markersize=size, zorder=4.0)
        for i, place in enumerate(marked, 1):
            axes.annotate(f"{i}", place, (4.0, 4.0), look=plot.ON_WHITE)
        axes.set(title=title, xlabel=f"axis {maps.axes[0]}, °", xticks=plot.nice_ticks(axes.get_xlim(), 4))
    every[0].set(ylabel=f"axis {maps.axes[1]}, °")
    return figure.svg()
