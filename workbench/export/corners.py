"""`export.corners`: a groove by seven corners, as trackers of submerged-arc welding describe it; and reading them."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Document, Groove
from workbench.errors import InputError
from workbench.stage import stage
from workbench.units import Float, Shaped

CORNERS = 7  # upper edge, root, three places between the roots, root, upper edge
TORCH = "Torchpos:"
MOST_ROWS = 1_000_000
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
ROW = re.compile(rf"{NUMBER}(?:,{NUMBER}){{{3 * CORNERS - 1}}},?")
NAMED = ("left_upper", "left_root", "right_root", "right_upper")


class SevenCorners(NamedTuple):
    """Corners of n rows, and where the torch was: lateral, along and up, in mm."""

    corners_mm: Shaped[Float, "n 7 3"]
    torch_mm: Shaped[Float, "n 2"]  # lateral and up; NaN where none is told


@stage("export.corners")
def corners(groove: Groove) -> Document:
    """Write `corners.csv`: seven corners a row, one row a station along the groove, as trackers in that trade do.

    x, y, z of each corner in metres: x across the groove from the left upper edge, falling towards the right plate; y
    along the groove; z up, from midway between the upper edges. Corners 0 and 6 are the upper edges, 1 and 5 the roots'
    upper edges, 2 to 4 lie evenly between these. Stations where one was not seen are left out.

    Args:
        groove: the measured groove, of a type with roots below both upper edges.

    Raises:
        InputError: a plate shows no root, or no station shows all corners.

    Example:
        >>> from workbench import edge, export, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> file = export.corners(edge.segment_groove(points))
        >>> file.name, file.content.splitlines()[0].count(b",")
        ('corners.csv', 20)
    """
    missing = [name for name in NAMED if name not in groove.corners]
    if missing:
        raise InputError("groove", f"type {groove.type} shows no {missing[0]}: seven corners need both plates' roots")
    section = np.stack([groove.corners[name].section_mm for name in NAMED], axis=1)
    seen = np.isfinite(section).all(axis=(1, 2)) & groove.seen
    if not seen.any():
        raise InputError("groove", "no station shows all corners")
    section = section[seen]
    share = np.array([0.25, 0.5, 0.75])[:, None]
    between = section[:, None, 1] + share * (section[:, None, 2] - section[:, None, 1])
    seven = np.concatenate([section[:, :2], between, section[:, 2:]], axis=1)
    lateral = seven[:, :1, 0] - seven[..., 0]
    along = np.broadcast_to(groove.arc_length_mm[seen][:, None], lateral.shape)
    return Document("corners.csv", written(np.stack([lateral, along, seven[..., 1]], axis=2)))


def written(corners_mm: Float) -> bytes:
    """Rows of corners (n, 7, 3) in mm as text in metres, to a hundredth of a micrometre."""
    rows = [",".join(f"{value:.8f}" for value in row) for row in 1e-3 * corners_mm.reshape(len(corners_mm), -1)]
    return "\r\n".join([*rows, ""]).encode("ascii")


def recognised(head: str) -> bool:
    """Whether a text begins as such a table does: 21 numbers a row, perhaps with lines of the torch between."""
    lines = [line.strip() for line in head.splitlines()[:4] if line.strip() and not line.startswith(TORCH)]
    return bool(lines) and ROW.fullmatch(lines[0]) is not None


def read_corners(text: str, where: str) -> SevenCorners:
    """Rows of seven corners in metres, each perhaps followed by `Torchpos:x,z`.

    Raises:
        InputError: a line that is neither.
    """
    rows: list[list[float]] = []
    torch: list[tuple[float, float]] = []
    lines = text.splitlines()
    for number, raw in enumerate(lines, 1):
        line = raw.strip()
        if not line:
            continue
        if line.startswith(TORCH):
            place = line[len(TORCH) :].split(",")
            if len(place) != 2 or not all(re.fullmatch(NUMBER, value.strip()) for value in place) or not rows:
                raise InputError(f"{where}: line {number}", f"expected {TORCH}x,z behind a row, found {line[:80]!r}")
            torch[-1] = float(place[0]), float(place[1])
        elif ROW.fullmatch(line) and len(rows) < MOST_ROWS:
            rows.append([float(value) for value in line.rstrip(",").split(",")])
            torch.append((np.nan, np.nan))
        elif number == len(lines):  # a log that was cut off in the middle of its last line
            break
        else:
            raise InputError(f"{where}: line {number}", f"expected {3 * CORNERS} numbers, found {line[:80]!r}")
    if not rows:
        raise InputError(where, f"expected rows of {3 * CORNERS} numbers, found none")
    corners_mm = 1e3 * np.array(rows).reshape(-1, CORNERS, 3)
    if not np.abs(corners_mm).max() < 1e6:
        raise InputError(where, "expected corners in metres, within 1 km")
    return SevenCorners(corners_mm, 1e3 * np.array(torch))
