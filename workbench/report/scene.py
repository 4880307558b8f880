"""What a view in space shows (points, dots, lines, outlined planes, in parallel projection), and its picture.

A recording may hold 50 million points and a picture a few hundred thousand, so frames and columns are thinned
before any coordinate is computed.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from workbench.artefacts import ROOT_FACE, UNLABELLED, Cloud, Edge, Mark, Scene, Section
from workbench.geometry.splat import Camera, draw_cloud
from workbench.marks import rgb
from workbench.pieces import INK
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

ROOM_ABOVE = 0.03  # of a picture's width, for the numbers of the planes


class View(NamedTuple):
    """A scene as it is looked at, in parallel projection: its first shading, all lines (one of a single point is a
    dot), and its marks as planes.
    """

    scene: Scene
    look: tuple[float, float, float]  # towards the viewer, along the scene's axes
    origin_mm: Shaped[Float, " 3"] | None = None  # in the base: where the axes stand
    axes_length_mm: float = 0.0  # 0: not drawn
    width_px: int = 1600


def everything_mm(scene: Scene) -> Float:
    """(q, 3) all that the scene shows, in the base."""
    lines = [line for strokes in scene.strokes for line in strokes.lines_mm]
    return np.vstack([scene.points_mm, *lines, *(mark.outline_mm for mark in scene.marks)])


def extent(points_mm: Float, look: Float, up: Float) -> tuple[Float, Float, Float]:
    """Rows right, up, to the viewer (3, 3) of a picture, and the lowest and highest corner of what is in it (3,)."""
    right = np.cross(up, look)
    right /= np.linalg.norm(right)
    screen = np.array([right, np.cross(look, right), look])
    seen = screen @ points_mm.T
    low, high = seen.min(axis=1), seen.max(axis=1)
    return screen, low, high + np.array([0.0, ROOM_ABOVE * (high[0] - low[0]), 0.0])


def aspect(low: Float, high: Float) -> float:
    """Height of a picture over its width, within what a page can hold."""
    return float(min(0.6, max(0.28, (high[1] - low[1]) / (high[0] - low[0]))))


ROOT_POINTS = 8  # points kept across the root face at least, so that thinning does not lose it
SURROUNDINGS_MM = 5.0  # unlabelled points are drawn this far about the faces; further off is background
AXES_POINTS = 5000  # that the principal axes of the faces are told from


class Points(NamedTuple):
    """Grid points that gave a return: coordinates in the base, face and place in the grid."""

    position_mm: Shaped[Float, "n 3"]  # base
    label: Shaped[AnyArray, " n"]  # uint8, face
    frame: Shaped[Int, " n"]
    column: Shaped[Int, " n"]

    def where(self, mask: Bool | Int) -> Points:
        """The points where `mask` (n,) holds, or those of the given indices in their order."""
        return Points._make(each[mask] for each in self)


def overview(cloud: Cloud, edge: Edge, budget: int) -> Points:
    """About `budget` kept points over the whole edge, spaced alike along and across it; the root face thinned least."""
    frames, columns = cloud.x_mm.shape
    surplus = frames * columns / budget
    pitch_ratio = _column_pitch_mm(cloud) / _frame_pitch_mm(edge, frames)
    frame_step = max(1, math.ceil(min(surplus, math.sqrt(surplus * pitch_ratio))))
    column_step = max(1, math.ceil(surplus / frame_step))
    root_columns = np.count_nonzero(edge.labels[::frame_step] == ROOT_FACE, axis=1).max(initial=0)
    root_step = max(1, min(column_step, int(root_columns) // ROOT_POINTS))
    column_step = root_step * math.ceil(column_step / root_step)
    points = _take(cloud, edge, np.arange(0, frames, frame_step), root_step)
    return _near_faces(points.where((points.label == ROOT_FACE) | (points.column % column_step == 0)))


def around(cloud: Cloud, edge: Edge, at_mm: float, reach_mm: float, budget: int) -> Points:
    """The kept points within `reach_mm` of the arc length `at_mm`, frames thinned to about `budget` points."""
    near = np.flatnonzero(np.abs(frame_arc_length_mm(cloud, edge) - at_mm) <= reach_mm)
    step = max(1, math.ceil(len(near) * cloud.x_mm.shape[1] / budget))
    return _near_faces(_take(cloud, edge, near[::step]))


def of_section(cloud: Cloud, edge: Edge, section: Section, budget: int) -> Points:
    """About `budget` kept points of the frames that a section rests on, from those nearest to it."""
    distance = np.abs(frame_arc_length_mm(cloud, edge)[section.frames] - section.arc_length_mm)
    nearest = np.argsort(distance, kind="stable")[: max(3, budget // cloud.x_mm.shape[1])]
    return _take(cloud, edge, section.frames[nearest])


def rejected(cloud: Cloud, edge: Edge, budget: int) -> tuple[Points, int]:
    """Points that gave a return and were rejected, out of about `budget` grid points of every k-th frame; and k."""
    frames, columns = cloud.x_mm.shape
    step = max(1, math.ceil(frames * columns / budget))
    return _take(cloud, edge, np.arange(0, frames, step), kept=False), step


def ends_of(cloud: Cloud, edge: Edge, face: int, frames: Int) -> tuple[Int, Int]:
    """Those of `frames` that show a face, and the columns (2, f) of its first and last kept point in each."""
    here = (edge.labels[frames] == face) & cloud.keep[frames]
    frames, here = frames[here.any(axis=1)], here[here.any(axis=1)]
    return frames, np.stack([here.argmax(axis=1), here.shape[1] - 1 - here[:, ::-1].argmax(axis=1)])


def root_ends(cloud: Cloud, edge: Edge, frames: Int) -> tuple[Points, Points]:
    """In each of `frames` the two outermost kept points of the root face: at its lower end, and at its upper end."""
    frames, ends = ends_of(cloud, edge, ROOT_FACE, frames)
    first, last = (at_places(cloud, edge, frames, columns) for columns in ends)
    across = edge.across[np.isfinite(edge.across).all(axis=1)].mean(axis=0)
    is_reversed = ((last.position_mm - first.position_mm) @ across < 0.0)[:, None]
    low = np.where(is_reversed[:, 0], ends[1], ends[0])
    return at_places(cloud, edge, frames, low), at_places(cloud, edge, frames, ends.sum(axis=0) - low)


def frame_arc_length_mm(cloud: Cloud, edge: Edge) -> Float:
    """(N,) arc length of each frame, interpolated where a frame does not see the edge; NaN in passes that never do."""
    arc_length = edge.frame_arc_length_mm.copy()
    for each in np.unique(cloud.pass_index):
        of_pass = np.flatnonzero(cloud.pass_index == each)
        seen = of_pass[np.isfinite(arc_length[of_pass])]
        if len(seen):
            arc_length[of_pass] = np.interp(of_pass, seen, arc_length[seen])
    return arc_length


def _take(cloud: Cloud, edge: Edge, frames: Int, column_step: int = 1, *, kept: bool = True) -> Points:
    """The points with a return in `frames`, every `column_step`-th column: those kept, or those rejected."""
    x, z = cloud.x_mm[frames, ::column_step], cloud.z_mm[frames, ::column_step]
    row, column = np.nonzero(np.isfinite(x) & np.isfinite(z) & (cloud.keep[frames, ::column_step] == kept))
    return at_places(cloud, edge, frames[row], column * column_step)


def at_places(cloud: Cloud, edge: Edge, frame: Int, column: Int) -> Points:
    """The points at places (n,) in the grid."""
    x_mm, z_mm = (grid[frame, column].astype(float)[:, None] for grid in (cloud.x_mm, cloud.z_mm))
    x_axis, z_axis, origin = (cloud.base_from_profiler[frame, :3, k] for k in (0, 2, 3))
    position = x_mm * x_axis + z_mm * z_axis + origin
    return Points(position, edge.labels[frame, column], frame, column)


def _near_faces(points: Points) -> Points:
    """Without the unlabelled points that lie outside the box about the labelled ones, along their principal axes."""
    labelled = points.label != UNLABELLED
    if np.count_nonzero(labelled) < 2:
        return points
    some = points.position_mm[np.flatnonzero(labelled)[:: max(1, len(labelled) // AXES_POINTS)]]
    axes = np.linalg.eigh(np.cov(some.T))[1]
    inside = np.ones(len(labelled), bool)
    for along in axes.T @ points.position_mm.T:
        of_faces = along[labelled]
        inside &= (along >= of_faces.min() - SURROUNDINGS_MM) & (along <= of_faces.max() + SURROUNDINGS_MM)
    return points.where(labelled | inside)


def _column_pitch_mm(cloud: Cloud) -> float:
    """Median distance of neighbouring columns in a few frames."""
    some = cloud.x_mm[:: max(1, len(cloud.x_mm) // 20)]
    pitch = np.abs(np.diff(some, axis=1))
    pitch = pitch[pitch > 0]
    return float(np.median(pitch)) if pitch.size else 1.0


def _frame_pitch_mm(edge: Edge, frames: int) -> float:
    """Mean distance of neighbouring frames along the edge."""
    length = float(np.ptp(edge.arc_length_mm)) if len(edge.arc_length_mm) else 0.0
    return length / frames if length > 0.0 else 1.0


FINER = 2  # lines are drawn so many times as large, then made smaller: smooth
LINE_PX, WORD_PX, DOT_PX, HEAD_PX = 3 * FINER, 23 * FINER, 3.0 * FINER, 12 * FINER  # width, height, radius, length
COLOURS = 256  # of the picture
NEAREST, QUICKLY = Image.Resampling.NEAREST, Image.Quantize.FASTOCTREE
TINT = 0.13  # opacity of a plane
MARGIN = 0.06  # of the picture, left free around what is in it
FAINT = 0.25  # opacity of an outline behind the part
STEP_PX, GAP_PX, NOISE_MM = 3.0, 7, 0.2  # an outline is looked at this often for what hides it; and how closely


def pictures(views: Mapping[str, View]) -> dict[str, bytes]:
    """PNG of each view."""
    return {name: picture(view) for name, view in views.items()}


def picture(view: View) -> bytes:
    """PNG of a view, at true scale. Paths and dots run inside the stock: drawn before it."""
    scene, camera = view.scene, camera_of(view)
    shade = scene.shadings[0]
    cloud = draw_cloud(scene.points_mm, shade.palette[shade.index], camera)
    known = np.nan_to_num(cloud.near_mm, nan=-np.inf)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(known, GAP_PX // 2, mode="edge"), (GAP_PX, GAP_PX))
    image = Image.fromarray(cloud.rgb).resize((FINER * camera.width_px, FINER * camera.height_px), NEAREST)
    draw = ImageDraw.Draw(image, "RGBA")
    for strokes in scene.strokes:
        for line, colour in zip(strokes.lines_mm, strokes.colours, strict=True):
            _draw_line(draw, camera.project(line), colour)
    for mark in scene.marks:
        _draw_plane(draw, camera, near, mark)
    if view.origin_mm is not None and view.axes_length_mm:
        _draw_axes(draw, camera, view.origin_mm, view.origin_mm + view.axes_length_mm * scene.axes, scene.axes_names)
    out = io.BytesIO()
    image.reduce(FINER).quantize(COLOURS, QUICKLY, dither=Image.Dither.NONE).save(out, format="png", compress_level=4)
    return out.getvalue()


def camera_of(view: View) -> Camera:
    """The camera that has all of a view in its picture."""
    axes = view.scene.axes
    towards: Float = axes.T @ (np.array(view.look) / np.linalg.norm(view.look))
    screen, low, high = extent(everything_mm(view.scene), towards, axes[2])
    width, shape = int(view.width_px), aspect(low, high)
    height = round(width * shape)
    across, up, _ = high - low
    scale = (1.0 - MARGIN) * min(width / across, height / up)
    return Camera(screen, screen.T @ ((low + high) / 2), scale, width, height)


def _draw_line(draw: ImageDraw.ImageDraw, seen: Float, colour: AnyArray) -> None:
    """A line of pixels (k, 3), each with the colour (k, 3) of the segment to it; a dot where it is one alone."""
    at = FINER * seen[:, :2]
    if len(at) == 1:
        (x, y), r = at[0], DOT_PX
        draw.ellipse((x - r, y - r, x + r, y + r), fill=_shade(colour[0]))
    colour = colour[1:]
    changes = np.flatnonzero((np.diff(colour.astype(int), axis=0) != 0).any(axis=1)) + 1
    for piece in np.split(np.arange(len(colour)), changes) if len(colour) else ():
        ends = at[piece[0] : piece[-1] + 2]
        draw.line([*map(tuple, ends.tolist())], fill=_shade(colour[piece[0]]), width=LINE_PX, joint="curve")


def _draw_plane(
    draw: ImageDraw.ImageDraw, camera: Camera, near: Shaped[Float32, "rows columns gap gap"], mark: Mark
) -> None:
    """A plane's outline, faint where the part hides it, with a tint and its name."""
    seen, colour = camera.project(mark.outline_mm), np.array(rgb(mark.colour))
    draw.polygon([*map(tuple, (FINER * seen[:4, :2]).tolist())], fill=_shade(colour, TINT))
    for start, end in pairwise(seen):
        steps = max(2, round(np.hypot(*(end - start)[:2]) / STEP_PX))
        way = start + np.linspace(0.0, 1.0, steps)[:, None] * (end - start)
        behind = _hidden((way[:-1] + way[1:]) / 2.0, near)
        for run in np.split(np.arange(len(behind)), np.flatnonzero(np.diff(behind)) + 1):
            ends = FINER * way[[run[0], run[-1] + 1], :2]
            shade = _shade(colour, FAINT if behind[run[0]] else 1.0)
            draw.line([*map(tuple, ends.tolist())], fill=shade, width=LINE_PX)
    x, y, _ = FINER * (seen[3] + 0.04 * (seen[3] - seen[0]))
    draw.text((x, y), mark.key, font=_font(), fill=INK, anchor="mb")


def _hidden(seen: Float, near_mm: Shaped[Float32, "rows columns gap gap"]) -> Bool:
    """(k,) whether places (column, row, near) lie behind the cloud; gaps between its points hide as well."""
    height, width = near_mm.shape[:2]
    column, row = (np.clip(seen[:, k].astype(int), 0, size - 1) for k, size in ((0, width), (1, height)))
    return np.asarray(near_mm[row, column].max(axis=(1, 2)) > seen[:, 2] + NOISE_MM)


def _draw_axes(
    draw: ImageDraw.ImageDraw, camera: Camera, origin_mm: Float, ends_mm: Float, names: tuple[str, ...]
) -> None:
    """The axes as arrows from the view's origin."""
    start = FINER * camera.project(origin_mm[None])[0, :2]
    for end, name in zip(FINER * camera.project(ends_mm)[:, :2], names, strict=True):
        along = (end - start) / max(1e-9, float(np.hypot(*(end - start))))
        across = np.array([-along[1], along[0]])
        draw.line([tuple(start), tuple(end - HEAD_PX / 2 * along)], fill=INK, width=LINE_PX)
        head = (end, end - HEAD_PX * along + HEAD_PX / 3 * across, end - HEAD_PX * along - HEAD_PX / 3 * across)
        draw.polygon([tuple(corner) for corner in head], fill=INK)
        draw.text(tuple(start + 1.15 * (end - start)), name, font=_font(), fill=INK, anchor="mm")


def _shade(colour: AnyArray, opacity: float = 1.0) -> tuple[int, ...]:
    return (*map(int, colour), round(255 * opacity))


@cache
def _font() -> ImageFont.ImageFont | ImageFont.FreeTypeFont:
    return ImageFont.load_default(WORD_PX)  # comes with pillow: the same everywhere
