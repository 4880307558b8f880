"""Bodies of a cell as triangles, and how they look: of every pixel the body that its ray meets first, by Open3D.

In parallel projection; no OpenGL is needed. A face is lit by how it turns to the viewer; outlines and edges are dark.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from workbench.geometry.poses import mapped
from workbench.geometry.splat import Camera
from workbench.robot.cell import Cell, Shape
from workbench.robot.collision import standing_poses
from workbench.robot.kinematics import motions
from workbench.units import DEG, AnyArray, Float

SIDES = 64  # of a round body
FAR_MM = 2e4  # from the middle of the picture to where rays begin
HUGE_MM = 7200.0  # a body that is larger, a floor or an envelope, is left out: it hides the others
FINER = 2  # a pixel is drawn as so many times so many, so that outlines are smooth
DARKEST = 0.35  # of a face that is seen along itself
CREASE = np.cos(40 * DEG)  # of neighbouring faces: sharper, their edge is drawn
HIDDEN_MM = 5.0  # so much behind a body a line is hidden
FONT_PX, LINE_PX, MARGIN_PX = 22, 28, 6
INK, PAPER = "#1b1f24", "#ffffff"
ROBOT, AROUND, RED = "#e8a33d", "#b9c2c9", "#d11f1f"
COLOURS = {"tool": "#4f5d75", "cutter": "#2f3a4f", "turntable": "#8d99a6", "workpiece": "#b59b6a"}
LOOKS = np.array([one for one in itertools.product(range(-2, 3), range(-2, 3), range(3)) if any(one[:2])])
CUBE = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))  # corners
Pixels = tuple[float, float, float, float]  # left, top, right, bottom


def cell_triangles(cell: Cell, joints: Float, turntable: Float | float, sides: int = SIDES) -> list[tuple[str, Float]]:
    """Body and triangles (t, 3, 3) of every shape, in the base, at joint angles (6,) and a turntable angle, rad."""
    moved = [*motions(cell.chain, joints), *standing_poses(cell, turntable)]  # by `Shape.link`
    found = []
    for shape in cell.shapes:
        pose, corners = moved[max(shape.link, 0)] @ shape.pose, shape_triangles(shape, sides)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        found.append((shape.body, mapped(pose, corners[area > 0])))
    return found


def colour_of(cell: Cell, body: str) -> str:
    """A body's colour by its name; what the cell does not hold is like what stands around."""
    robot = body in {shape.body for shape in cell.shapes if 0 <= shape.link <= 6}
    return COLOURS.get(body, ROBOT if robot else AROUND)


def shape_triangles(shape: Shape, sides: int = SIDES) -> Float:
    """Triangles (t, 3, 3) of a shape in its own frame: those of its mesh, or of a box, or turned about z."""
    if shape.vertices_mm is not None:
        return np.asarray(shape.vertices_mm[shape.triangles])
    if shape.kind == "box":
        half = np.array(shape.size_mm) / 2
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        levels = ((0, -half[2]), (1, -half[2]), (1, half[2]), (0, half[2]))
        return _skin(np.array([np.column_stack([ring * s, np.full(4, z)]) for s, z in levels]))
    radius = shape.size_mm[0]
    length = shape.size_mm[1] if len(shape.size_mm) > 1 else 0.0
    if shape.kind == "cylinder":
        outline = np.array([[0, -length / 2], [radius, -length / 2], [radius, length / 2], [0, length / 2]])
    else:
        bow = np.linspace(0, np.pi / 2, sides // 4 + 2)
        cap = np.column_stack([radius * np.sin(bow), length / 2 + radius * np.cos(bow)])
        outline = np.vstack([cap * (1, -1), cap[::-1]])
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return _skin(np.array([np.column_stack([r * circle, np.full(sides, z)]) for r, z in outline]))


def _skin(rings: Float) -> Float:
    """Triangles between rings (r, k, 3) one above the other."""
    a, b = rings[:-1], rings[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    return np.concatenate(
        [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, a_next, b_next), (a, b_next, b))]
    )


def is_huge(triangles_mm: Float) -> bool:
    """Whether a body (t, 3, 3) is left out."""
    return bool(np.ptp(triangles_mm.reshape(-1, 3), axis=0).max(initial=0.0) > HUGE_MM)


def looking(
    look: Sequence[float],
    up: Sequence[float],
    points_mm: Float,
    size_px: tuple[int, int],
    share: float = 1.0,
    lines: int = 0,
) -> Camera:
    """A parallel projection in which points (n, 3) fill a share of the picture's width or height, below a caption.

    Args:
        look: from what is seen to the viewer, of any length.
        up: what is upright in the picture.
        points_mm: (n, 3).
        size_px: width and height.
        share: of the picture.
        lines: of the caption.
    """
    towards = np.array(look) / np.linalg.norm(look)
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    screen = np.array([right, np.cross(towards, right), towards])
    seen = points_mm @ screen.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    above = lines * LINE_PX
    wide, tall = (max(mm, 1.0) for mm in (high - low)[:2])
    scale = share * min(size_px[0] / wide, (size_px[1] - above) / tall)
    middle = (low + high) / 2 + np.array([0.0, above / 2 / scale, 0.0])
    return Camera(screen, screen.T @ middle, scale, *size_px)


def clearest(bodies: Sequence[Float], path_mm: Float, fan_mm: Sequence[Float]) -> Sequence[float]:
    """Direction to the viewer in which bodies (t, 3, 3) hide least of a path (n, 3) and a fan of rays (n, 3).

    Times the path's length on screen, and the fan's area.
    """
    towards = LOOKS / np.linalg.norm(LOOKS, axis=1)[:, None]
    begin = np.concatenate([path_mm, *fan_mm])[:, None] + towards  # a millimetre off
    rays = np.concatenate([begin, np.broadcast_to(towards, begin.shape)], axis=-1)
    free = np.isinf(_met(bodies, path_mm[0], rays)["t_hit"].numpy())
    seen = free.mean(axis=0) * np.linalg.norm(np.cross(path_mm[-1] - path_mm[0], towards), axis=1)
    if fan_mm:
        seen *= np.abs(towards @ np.cross(*(ray[-1] - ray[0] for ray in (fan_mm[0], fan_mm[-1]))))
    best: list[float] = towards[seen.argmax()].tolist()
    return best


class Sheet:
    """A picture of bodies, on which lines and texts are put; no text covers another or leaves the picture."""

    def __init__(self, camera: Camera, bodies: Sequence[tuple[Float, str]]) -> None:
        """Draw bodies: triangles (t, 3, 3), mm, and '#rrggbb'."""
        self.camera = camera.finer(FINER)
        pixels, self._depth_mm = _cast(self.camera, [body for body in bodies if len(body[0])])
        self.image = Image.fromarray(pixels)
        self._draw = ImageDraw.Draw(self.image)
        self._font = ImageFont.load_default(FINER * FONT_PX)
        self._taken: list[Pixels] = []

    def line(self, points_mm: Float, colour: str, width_px: float) -> None:
        """A line through points (n, 3), over all bodies."""
        at = [(float(x), float(y)) for x, y, _ in self.camera.project(points_mm)]
        self._draw.line(at, fill=colour, width=round(FINER * width_px), joint="curve")

    def hidden_line(self, ends_mm: Float, colour: str) -> None:
        """A thin straight line between two points (2, 3) where no body lies before it."""
        start, end = self.camera.project(ends_mm)
        count = int(np.abs(end - start)[:2].max()) + 2
        column, row, depth = (start + np.linspace(0, 1, count)[:, None] * (end - start)).T
        at = np.column_stack([row, column]).astype(int)
        inside: Any = ((at >= 0) & (at < self._depth_mm.shape)).all(axis=1)
        free = inside.copy()
        free[inside] = depth[inside] > self._depth_mm[tuple(at[inside].T)] - HIDDEN_MM
        for y, x in at[free].tolist():
            self._draw.rectangle((x, y, x + 1, y + 1), fill=colour)

    def shows(self, points_mm: Float) -> bool:
        """Whether any of some points (n, 3) lies in the picture."""
        at = self.camera.project(points_mm)[:, :2]
        return bool(((at >= 0) & (at <= self.image.size)).all(axis=1).any())

    def note(self, place_mm: Float, beside_px: tuple[float, float], text: str, colour: str = INK) -> None:
        """A text beside a place (3,), right and up of it by `beside_px` or where there is room around, and a line."""
        at = self.camera.project(place_mm[None])[0, :2]
        boxes = [self._kept(at + FINER * aside, text) for aside in _around(np.array(beside_px))]
        box = next((one for one in boxes if not any(_overlap(one, other) for other in self._taken)), boxes[0])
        self._draw.line([*at.tolist(), *np.clip(at, box[:2], box[2:]).tolist()], fill=colour, width=FINER)
        self._put(box, text, colour)

    def caption(self, text: str) -> None:
        """Lines in the upper left corner."""
        self._put(self._kept(np.zeros(2), text), text, INK)

    def _put(self, box: Pixels, text: str, colour: str) -> None:
        self._taken.append(box)
        self._draw.rectangle(box, fill=PAPER)
        self._draw.text((box[0] + MARGIN_PX, box[1] + MARGIN_PX), text, fill=colour, font=self._font)

    def _kept(self, at: Float, text: str) -> Pixels:
        """The box of a text about a place (2,), moved into the picture."""
        size = np.array(self._draw.textbbox((0, 0), text, font=self._font)[2:]) + 2 * MARGIN_PX
        corner = np.clip(at - size / 2, 0, np.array(self.image.size) - size)
        return (*corner.tolist(), *(corner + size).tolist())

    def smaller(self) -> Image.Image:
        """The picture in its own size."""
        width, height = self.image.size
        return self.image.resize((width // FINER, height // FINER), Image.Resampling.LANCZOS)


def png(image: Image.Image) -> bytes:
    """The file of a picture."""
    made = io.BytesIO()
    image.save(made, "PNG")
    return made.getvalue()


def _around(aside: Float) -> Iterator[Float]:
    """A vector (2,), right and up, and the same turned either way and longer; in pixels, right and down."""
    for longer in (1.0, 1.5, 2.0):
        for turn in np.array([0, 25, -25, 50, -50, 90, -90, 140, -140]) * DEG:
            c, s = np.cos(turn), np.sin(turn)
            yield longer * np.array([[c, -s], [s, c]]) @ aside * (1, -1)


def _overlap(a: Pixels, b: Pixels) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _cast(camera: Camera, bodies: Sequence[tuple[Float, str]]) -> tuple[AnyArray, Float]:
    """Pixels (h, w, 3), and how far what they show lies towards the viewer (h, w), mm; -inf where nothing is."""
    row, column = np.indices((camera.height_px, camera.width_px)) + 0.5
    across = np.stack([column - camera.width_px / 2, camera.height_px / 2 - row], axis=-1) / camera.scale_px_mm
    begin = camera.centre_mm + across @ camera.screen[:2] + FAR_MM * camera.screen[2]
    rays = np.concatenate([begin, np.broadcast_to(-camera.screen[2], begin.shape)], axis=-1)
    found = _met([triangles for triangles, _ in bodies], camera.centre_mm, rays)
    body = np.minimum(found["geometry_ids"].numpy(), len(bodies))  # the last: none
    normal = found["primitive_normals"].numpy()
    light = DARKEST + (1 - DARKEST) * np.abs(normal @ camera.screen[2])
    tints = np.array([[int(tint[i : i + 2], 16) for i in (1, 3, 5)] for tint in (*(c for _, c in bodies), PAPER, INK)])
    pixels = tints[body] * np.where(body < len(bodies), light, 1.0)[..., None]
    pixels[_edges(body, normal)] = tints[-1]
    return pixels.astype(np.uint8), FAR_MM - found["t_hit"].numpy()


def _met(bodies: Sequence[Float], centre_mm: Float, rays: Float) -> Any:
    """What rays (..., 6) meet first of bodies (t, 3, 3), as Open3D tells it; in single precision about a centre."""
    import open3d

    space = open3d.t.geometry.RaycastingScene()
    tensor: Any = open3d.core.Tensor  # its stub knows no arrays
    for triangles in bodies:
        corners = (triangles.reshape(-1, 3) - centre_mm).astype(np.float32)
        space.add_triangles(tensor(corners), tensor(np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)))
    return space.cast_rays(tensor((rays - np.append(centre_mm, np.zeros(3))).astype(np.float32)))


def _edges(body: AnyArray, normal: Float) -> AnyArray:
    """Pixels (h, w) beside which another body is seen, or a face that turns sharply."""
    found = np.zeros(body.shape, bool)
    for axis in (0, 1):
        first, second = [slice(None)] * 2, [slice(None)] * 2
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        one, other = tuple(first), tuple(second)
        turned = np.abs((normal[one] * normal[other]).sum(axis=-1)) < CREASE
        unlike = (body[one] != body[other]) | (turned & np.any(normal[one], axis=-1))
        found[one] |= unlike
        found[other] |= unlike
    return found
