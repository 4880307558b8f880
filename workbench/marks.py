"""The report's colours, told apart with any colour vision (after Okabe and Ito), dark enough to print; SVG in them."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from html import escape
from typing import NamedTuple, TypeAlias

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, UNLABELLED, UPPER_SURFACE
from workbench.pieces import BLUE, GREEN, INK, ORANGE, PURPLE
from workbench.units import AnyArray, Float

DOTS_PX = 200.0 / 72.0  # pixels a point, of dots drawn as a picture
FARTHEST_PT = 1e6  # from the sheet, of what is drawn
SHADES = 31  # of a dot's opacity
PACKED = 3  # zlib's level: a third of the time of level 6 for a tenth more bytes
HEAD = (3.2, 1.3)  # of an arrow: length and half its width

Colour: TypeAlias = str | Sequence[float] | AnyArray

AIR = "#98a1ad"
MEASURED, TOLERANCE, LIMIT, REJECTED = BLUE, "#d9efe6", "#00664b", PURPLE

FACES = {
    ROOT_FACE: ORANGE,
    BEVEL_FACE: BLUE,
    UPPER_SURFACE: "#8fa3ad",
    LOWER_SURFACE: "#b79f6a",
    UNLABELLED: "#d5d9de",
}
LOWER_EDGE, UPPER_EDGE = BLUE, ORANGE
TOOL_AXES = (ORANGE, GREEN, BLUE)  # x, y, z of a key point
# viridis up to 0.86: it keeps its order with any colour vision, and in grey.
ANCHORS = ("#440154", "#482677", "#3f4889", "#32658e", "#27808e", "#1f998a", "#2eb37c", "#5ec962", "#a2da37")
DIVERGING = ("#063a6b", "#2f7fbf", "#a5cbe6", "#ececec", "#f5b195", "#cc463c", "#6b0a1e")  # below 0 blue, above red
VERDICTS = {"pass": "#00664b", "fail": "#a8200d", "undecided": "#8a5a00"}
SIGNS = {"pass": "✓", "fail": "✕", "undecided": "?"}


def rgb(colour: str) -> tuple[int, int, int]:
    """'#rrggbb' as red, green, blue from 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def ramp(fraction: Float, anchors: Sequence[str] = ANCHORS) -> AnyArray:
    """(n, 3) uint8 for values (n,) from 0, the first of the colours (dark), to 1, the last (light)."""
    known = np.array([rgb(anchor) for anchor in anchors], float)
    at = np.clip(np.nan_to_num(np.asarray(fraction, float)), 0.0, 1.0) * (len(known) - 1)
    return np.stack([np.interp(at, np.arange(len(known)), known[:, k]) for k in range(3)], axis=-1).astype(np.uint8)


def face_shades() -> AnyArray:
    """(256, 3) uint8: the colour of each face label."""
    return np.array([rgb(FACES.get(label, FACES[UNLABELLED])) for label in range(256)], dtype=np.uint8)


class Lettering(NamedTuple):
    """How a text looks."""

    ink: Colour = INK
    weight: str = "normal"
    rotation: float = 0.0  # deg
    box: bool = False  # on white


PLAIN, UPRIGHT = Lettering(), Lettering(rotation=90.0)


def pt(value: float) -> str:
    """A number of a path, as short as a hundredth of a point allows."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def code(colour: Colour) -> str:
    """'#rrggbb' of a name, or of shares of red, green and blue."""
    return (
        colour
        if isinstance(colour, str)
        else "#{:02x}{:02x}{:02x}".format(*(round(255 * float(c)) for c in colour[:3]))
    )


def stroke(ink: str, width: float, dashes: Sequence[float] = ()) -> str:
    """How a line is drawn; dashes and gaps in widths of it."""
    dashed = f' stroke-dasharray="{" ".join(pt(width * d) for d in dashes)}"' if dashes else ""
    return f'stroke="{ink}" stroke-width="{pt(width)}" stroke-linejoin="round"{dashed}'


def filled(colour: Colour, hatch: str = "") -> str:
    """How an area is filled."""
    return 'fill="url(#h)"' if hatch else f'fill="{code(colour)}"'


def path_data(at: Float) -> str:
    """Lines through places (n, 2) on paper, begun anew after each that is not finite."""
    known = np.asarray(np.isfinite(at).all(axis=1)).tolist()
    rounded = np.round(np.clip(at, -FARTHEST_PT, FARTHEST_PT), 2)
    out, pen = [], False
    for (x, y), there in zip(rounded.tolist(), known, strict=True):
        if there:
            out.append(f"{'L' if pen else 'M'}{x:g} {y:g}")
        pen = there
    return "".join(out)


def markers(at: Float, marker: str, ink: str, size: float) -> str:
    """Circles (o), triangles (^) or crosses at places (n, 2) on paper."""
    r = size / 2
    if marker == "o":
        return "".join(f'<circle cx="{pt(x)}" cy="{pt(y)}" r="{pt(r)}" fill="{ink}"/>' for x, y in at)
    if marker == "^":
        d = "".join(f"M{pt(x)} {pt(y - r)}l{pt(r)} {pt(2 * r)}h{pt(-2 * r)}Z" for x, y in at)
        return f'<path d="{d}" fill="{ink}"/>'
    d = "".join(
        f"M{pt(x - r)} {pt(y - r)}l{pt(2 * r)} {pt(2 * r)}m0 {pt(-2 * r)}l{pt(-2 * r)} {pt(2 * r)}" for x, y in at
    )
    return f'<path d="{d}" fill="none" {stroke(ink, 1.0)}/>'


def arrow_head(x: float, y: float, dx: float, dy: float) -> str:
    """An arrow's head at a place, in a direction."""
    long, wide = HEAD
    size = math.hypot(dx, dy) or 1.0
    ux, uy = dx / size, dy / size
    left = (x - long * ux - wide * uy, y - long * uy + wide * ux)
    right = (x - long * ux + wide * uy, y - long * uy - wide * ux)
    return f"M{pt(x)} {pt(y)}L{pt(left[0])} {pt(left[1])}L{pt(right[0])} {pt(right[1])}Z"


def text_width(text: str, size: float) -> float:
    """About how wide a text is."""
    return 0.62 * size * max(map(len, text.split("\n")))


def text_element(
    text: str,
    x: float,
    y: float,
    size: float,
    ha: str,
    va: str,
    look: Lettering = PLAIN,
) -> str:
    """A text of one line or several, aligned about (x, y)."""
    rows, step = text.split("\n"), 1.2 * size
    first = {"baseline": 0.0, "bottom": -0.24 * size, "top": 0.78 * size, "center": 0.36 * size}[va]
    first -= {"baseline": 1.0, "bottom": 1.0, "top": 0.0, "center": 0.5}[va] * step * (len(rows) - 1)
    anchor = {"left": "start", "center": "middle", "right": "end"}[ha]
    bold = f' font-weight="{look.weight}"' if look.weight != "normal" else ""
    halo = ' stroke="white" stroke-width="3" paint-order="stroke"' if look.box else ""
    lines = "".join(f'<tspan x="0" y="{pt(first + k * step)}">{escape(row)}</tspan>' for k, row in enumerate(rows))
    rotation = f" rotate({pt(-look.rotation)})" if look.rotation else ""
    return (
        f'<text transform="translate({pt(x)} {pt(y)}){rotation}" font-size="{pt(size)}" text-anchor="{anchor}" '
        f'fill="{code(look.ink)}"{bold}{halo}>{lines}</text>'
    )


def dots(at: Float, box: tuple[float, float, float, float], ink: str, radius: float, alpha: float) -> str:
    """Many dots of one colour as a picture: where several lie on each other it is the more opaque."""
    from PIL import Image

    left, top, width, height = box
    columns, rows = (max(1, round(one * DOTS_PX)) for one in (width, height))
    place = (np.clip(at, -FARTHEST_PT, FARTHEST_PT) - (left, top)) * DOTS_PX
    place = place[(np.abs(place) < 2 * max(rows, columns)).all(axis=1)]  # not a number is left out as well
    r = radius * DOTS_PX
    off = np.mgrid[-math.ceil(r) : math.ceil(r) + 1, -math.ceil(r) : math.ceil(r) + 1].reshape(2, -1)
    cover = np.clip(r + 0.5 - np.hypot(*off), 0.0, 1.0)  # of the pixels about a dot
    off, cover = off[:, cover > 0.0], cover[cover > 0.0]
    x, y = (np.floor(place[:, k]).astype(np.int64)[:, None] + off[1 - k] for k in (0, 1))
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    weights, x, y = np.broadcast_to(cover, x.shape)[inside], x[inside], y[inside]
    if not len(x):
        return ""
    (x0, wide), (y0, high) = ((int(one.min()), int(np.ptp(one)) + 1) for one in (x, y))  # no more than has dots
    weight = np.bincount((y - y0) * wide + (x - x0), weights, minlength=high * wide)
    left_open = np.power(1.0 - min(alpha, 0.999), weight, np.ones_like(weight), where=weight > 0.0)  # of most all
    image = Image.frombytes("P", (wide, high), np.round(SHADES * (1.0 - left_open)).astype(np.uint8).tobytes())
    image.putpalette(rgb(ink) * (SHADES + 1))
    out = io.BytesIO()
    image.save(
        out, "png", compress_level=PACKED, transparency=bytes(round(255 * k / SHADES) for k in range(SHADES + 1))
    )
    across, down = width / columns, height / rows
    return embedded(out.getvalue(), (left + x0 * across, top + y0 * down, wide * across, high * down))


def embedded(png: bytes, box: tuple[float, float, float, float], look: str = "") -> str:
    """A picture that fills a box (left, top, width, height) on paper."""
    left, top, width, height = map(pt, box)
    return (
        f'<image x="{left}" y="{top}" width="{width}" height="{height}" preserveAspectRatio="none"{look} '
        f'href="data:image/png;base64,{base64.b64encode(png).decode()}"/>'
    )


def cells(shades: AnyArray, box: tuple[float, float, float, float]) -> str:
    """Cells of a grid (rows, columns, 4), uint8, the first row lowest, as a picture that fills a box."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(shades[::-1])).save(out, "png")
    return embedded(out.getvalue(), box, ' style="image-rendering:pixelated"')
