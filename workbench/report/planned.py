"""What the plan's pictures and tables rest on: the path as it is run, the bevel that its final layer makes, colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Edge, Layer, RawEdge, Toolpath
from workbench.geometry.moves import step_lengths_mm, step_times_s
from workbench.geometry.poses import rotation_from_quaternion
from workbench.report.along import axes_at, developed
from workbench.report.chart_parts import svg
from workbench.report.colours import AIR, rgb
from workbench.report.plot import Figure
from workbench.report.text import alike
from workbench.units import DEG, AnyArray, Bool, Float, Int, Shaped

LOCAL_MM = 10.0  # of edge to both sides, whose least-squares plane is the direction of a rough end face
# viridis up to 0.86: it keeps its order with any colour vision, and in grey.
ANCHORS = ("#440154", "#482677", "#3f4889", "#32658e", "#27808e", "#1f998a", "#2eb37c", "#5ec962", "#a2da37")
SHADES = 64  # of a continuous scale
MOST_NAMES = 12  # layers that a scale names


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The whole path in the order in which it is run, k points, in the base."""

    position_mm: Shaped[Float, "k 3"]
    feed_mm_s: Shaped[Float, " k"]
    cutting: Shaped[Bool, " k"]
    layer: Shaped[Int, " k"]  # index of the layer; 0: travel between layers
    length_mm: Shaped[Float, " k"]  # of the step to the point
    time_s: Shaped[Float, " k"]  # of the step to the point

    @property
    def cutting_step(self) -> Bool:
        """(k,) whether the step to the point cuts: both its ends do."""
        cuts = self.cutting.copy()
        cuts[1:] &= self.cutting[:-1] & (np.diff(self.layer) == 0)
        return cuts

    @property
    def layer_start(self) -> Int:
        """(l,) where each layer and each travel move begins."""
        return np.flatnonzero(np.diff(self.layer, prepend=-1))


@dataclass(frozen=True, slots=True, eq=False)
class PlannedBevel:
    """Root face and bevel angle that the final layer makes at its k cutting points, in their section planes."""

    arc_length_mm: Shaped[Float, " k"]
    root_mm: Shaped[Float, " k"]
    bevel_deg: Shaped[Float, " k"]


def whole_run(toolpath: Toolpath) -> Run:
    """Travels and layers in turn."""
    parts = toolpath.in_order
    position = toolpath.in_base(np.concatenate([part.position_mm for part in parts]))
    feed = np.concatenate([part.feed_mm_s for part in parts])
    cutting = [p.cutting if isinstance(p, Layer) else np.zeros(len(p.feed_mm_s), dtype=bool) for p in parts]
    layer = [np.full(len(p.feed_mm_s), p.index if isinstance(p, Layer) else 0) for p in parts]
    return Run(
        position,
        feed,
        np.concatenate(cutting),
        np.concatenate(layer),
        step_lengths_mm(position),
        step_times_s(position, feed),
    )


def frames_in_base(toolpath: Toolpath, layer: Layer) -> Float:
    """(k, 3, 3) x, y, z of a layer's points as columns, in the base."""
    rotation = rotation_from_quaternion(layer.quaternion_wxyz)
    return rotation if toolpath.base_from_workobject is None else toolpath.base_from_workobject[:3, :3] @ rotation


def planned_bevel(toolpath: Toolpath, edge: Edge) -> PlannedBevel:
    """Where the final layer's plane, or its ball end, meets the measured end face, and at what angle its plane does."""
    final = toolpath.layers[-1]
    cut = final.cutting
    s, u, v = developed(toolpath.in_base(final.position_mm[cut]), final.arc_length_mm[cut], edge).T
    frames, radius = frames_in_base(toolpath, final)[cut], toolpath.root_radius_mm
    sides = [axes_at(s, edge, each) for each in (edge.normal, edge.across)]
    (out, up), inward = (np.einsum("ij,kij->ki", frames[:, :, k], sides) for k in (2, 0))
    root = v - u * up / out
    if radius:  # the ball's centre is (u, v) of the frame, down the axis, and a radius off
        reach = toolpath.cutter.cylinder_end_mm
        ball_u, ball_v = u + reach * out - radius * inward[0], v + reach * up - radius * inward[1]
        root = ball_v - np.sqrt(np.maximum(radius**2 - ball_u**2, 0.0))
    return PlannedBevel(s, root, np.arctan2(np.abs(out), np.abs(up)) / DEG)


def middle_of_cut_mm(toolpath: Toolpath) -> float | None:
    """Arc length of the middle of the longest stretch that the final layer cuts; None where it cuts nowhere."""
    final = toolpath.layers[-1]
    change = np.flatnonzero(np.diff(np.r_[False, final.cutting, False]))
    if not len(change):
        return None
    first, last = final.arc_length_mm[change[::2]], final.arc_length_mm[change[1::2] - 1]
    k = int(np.argmax(last - first))
    return float(first[k] + last[k]) / 2.0


def planned_u(edge: Edge, toolpath: Toolpath) -> tuple[float | None, float | None]:
    """Standard uncertainty of the planned root face, mm, and bevel angle, deg: of scan, hand-eye pose and stated links.

    The plane meets the end face at v = r: an error (du, dv) of the lower edge moves that by dv + du / tan(beta); a
    fillet meets it square, and is moved by dv. None where the edge does not state its own.
    """
    if not isinstance(edge, RawEdge):
        return None, None
    shared = 0.0 if edge.hand_eye_u_mm is None else edge.hand_eye_u_mm
    place_mm, turn = (0.0, 0.0) if toolpath.chain is None else (toolpath.chain.place_mm, toolpath.chain.turn)
    u_out, u_across = np.nanmedian(np.hypot(np.hypot(edge.position_u_mm, shared), place_mm), axis=0)
    root = float(u_across if toolpath.root_radius_mm else np.hypot(u_across, u_out / np.tan(toolpath.bevel_deg * DEG)))
    return root, float(np.median(np.hypot(edge.normal_u, turn)) / DEG)


def local_turn_deg(edge: Edge) -> float | None:
    """Standard deviation of the end face's direction from place to place, deg, beside what turns evenly; None: unknown.

    From its second differences over `LOCAL_MM`, whose variance is six times that of independent places.
    """
    apart = round(LOCAL_MM / float(np.median(np.diff(edge.arc_length_mm))))
    if not isinstance(edge, RawEdge) or len(edge.normal) <= 2 * apart:
        return None
    n, seen = np.where(edge.seen[:, None], edge.normal, np.nan), edge.across[apart:-apart]
    bend = np.einsum("ij,ij->i", n[2 * apart :] - 2.0 * n[apart:-apart] + n[: -2 * apart], seen)
    bend = bend[np.isfinite(bend)]
    return float(np.sqrt(np.mean(bend**2) / 6.0) / DEG) if len(bend) else None


def thickness_mm(edge: Edge) -> Float:
    """(n,) height of a raw edge's end face at its stations; NaN where hidden."""
    if not isinstance(edge, RawEdge):
        return np.full(len(edge.arc_length_mm), np.nan)
    rise = edge.upper_position_mm - edge.position_mm
    return np.asarray(np.einsum("ij,ij->i", rise, edge.across))


def ramp(fraction: Float) -> AnyArray:
    """(n, 3) uint8 for values (n,) from 0 (dark) to 1 (light)."""
    known = np.array([rgb(anchor) for anchor in ANCHORS], float)
    at = np.clip(np.nan_to_num(np.asarray(fraction, float)), 0.0, 1.0) * (len(known) - 1)
    return np.stack([np.interp(at, np.arange(len(known)), known[:, k]) for k in range(3)], axis=-1).astype(np.uint8)


def layer_colours(layer: AnyArray, count: int) -> AnyArray:
    """(k, 3): light for the first layer, dark for the final one, grey for travel moves between layers."""
    colour = ramp((count - np.asarray(layer)) / max(1, count - 1))
    return np.where((np.asarray(layer) == 0)[:, None], rgb(AIR), colour)


def feed_colours(run: Run) -> AnyArray:
    """(k, 3): the darker the slower."""
    low, high = feed_range(run)
    return ramp((run.feed_mm_s - low) / (high - low))


def feed_range(run: Run) -> tuple[float, float]:
    """Slowest and fastest feed of a path, mm/s; from 0 where they are one."""
    low, high = float(run.feed_mm_s.min()), float(run.feed_mm_s.max())
    return (low, high) if high - low > 1e-3 * high else (0.0, high)


def feed_scale(run: Run) -> bytes:
    """SVG of the colour bar of feeds."""
    return _scale(ramp(np.linspace(0.0, 1.0, SHADES)), feed_range(run), "feed, mm/s")


def layer_scale(toolpath: Toolpath) -> bytes:
    """SVG of the colour bar of layers, with their heights above the finished bevel."""
    count = len(toolpath.layers)
    shades = layer_colours(np.arange(1, count + 1), count)
    heights = alike(*(round(layer.height_mm, 6) for layer in toolpath.layers))
    named = np.unique(np.linspace(1, count, min(count, MOST_NAMES)).round().astype(int))
    names = [f"{k} ({heights[k - 1]} mm)" for k in named]
    label = "layer (its height above the finished bevel)"
    return _scale(shades, (0.5, count + 0.5), label, named.tolist(), names)


def _scale(
    shades: AnyArray, limits: tuple[float, float], label: str, at: Sequence[float] = (), names: Sequence[str] = ()
) -> bytes:
    figure = Figure(figsize=(10, 0.62))
    axes = figure.add_axes((0.2, 0.72, 0.6, 0.22))
    axes.set(xlim=limits, ylim=(0.0, 1.0))
    axes.shades(list(shades / 255.0))
    axes.set_yticks([], [])
    if at:
        axes.set_xticks(at, names)
    axes.tick_params(length=2.5, pad=2)
    axes.set_xlabel(label)
    return svg(figure)
