"""Points of a file in one of the formats of scanners and viewers: run as a process of its own by `cloud.read`.

Open3D, libE57 and their like crash on damaged files, or print a warning and go on with what they have. Here that costs
a child process, and what it prints is the reason of the refusal: `python -P readers.py FILE OUT.npy`.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from workbench.children import confine, library
from workbench.units import Float

CPU_SECONDS, BYTES_A_SECOND = 8, 200_000  # what a reader may take: at least, and for each so many bytes one more
PCD_LINE = 65_536  # bytes, of a header's line
LAS_RECORD_BYTES = 54  # of a record's own header: ASPRS LAS 1.4, table 4
NUMBER = r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
READING = re.compile(rf"\bX={NUMBER}\s+Y={NUMBER}\s+Z={NUMBER}")
WAYS = ((None, "."), (",", "."), (";", "."), (";", ","), (None, ","))  # what separates cells, and decimals
OF_UNIT = re.compile(r"\s*[\[(].*[\])]$|_\w+$")  # behind a column's name


def main() -> int:
    """Read FILE, write its points (n, 3), in the file's own unit, to OUT.npy. What goes wrong is said in one line."""
    file, out = sys.argv[1:]
    size = os.path.getsize(file)
    confine(size, CPU_SECONDS + size // BYTES_A_SECOND)
    try:
        np.save(out, READERS[Path(file).suffix.lower()](file))
    except MemoryError:
        print("it declares more points than it can hold")
        return 1
    except Exception as error:  # whatever a library makes of a damaged file
        print(str(error).splitlines()[0] if str(error) else type(error).__name__)
        return 1
    return 0


def _point_cloud(file: str) -> Float:
    o3d = library("open3d")

    return np.asarray(o3d.io.read_point_cloud(Path(file), remove_nan_points=True, remove_infinite_points=False).points)


def _pcd(file: str) -> Float:
    """By Open3D's newer reader, since the older one misreads double coordinates beside other fields."""
    o3d = library("open3d")

    _check_pcd(file)
    points = o3d.t.io.read_point_cloud(Path(file), remove_infinite_points=False).point
    return np.asarray(points.positions.numpy(), dtype=np.float64) if "positions" in points else np.empty((0, 3))


def pcd_header(file: str | Path) -> tuple[dict[str, list[str]], int]:
    """The header's lines by their first word, DATA the last, and where the points begin.

    Raises:
        ValueError: no line DATA.
    """
    with open(file, "rb") as stream:
        header: dict[str, list[str]] = {}
        while "DATA" not in header:
            line = stream.readline(PCD_LINE)
            if not line:
                raise ValueError("its header has no DATA line")
            name, *values = line.decode("ascii", errors="replace").split() or [""]
            header[name] = values
        return header, stream.tell()


def _check_pcd(file: str) -> None:
    """Compare what the header declares with the file's length: Open3D allocates it unseen."""
    header, start = pcd_header(file)
    left, points = os.path.getsize(file) - start, int(header["POINTS"][0])
    record = sum(int(size) * int(n) for size, n in zip(header["SIZE"], header["COUNT"], strict=True))
    need = {"binary": points * record, "ascii": 2 * points}.get(header["DATA"][0], 0)
    if left < need:
        raise ValueError(f"{points} points are declared, too many for the {left} bytes that follow")


def _mesh_vertices(file: str) -> Float:
    """Each vertex once: STL repeats it for every triangle."""
    o3d = library("open3d")

    points = np.asarray(o3d.io.read_triangle_mesh(Path(file)).vertices)
    return points[np.sort(np.unique(points, axis=0, return_index=True)[1])]


def _table(file: str) -> Float:
    """The columns x, y, z of a header, else the first three; separated by spaces, tabs, commas or semicolons.

    Decimals have a comma where that alone makes numbers. Lines with # are comments.

    Of trackers also `X= ... Y= ... Z= ...` in a line; a row with INVALID in it is no return.
    """
    with open(file, encoding="utf-8", errors="replace") as lines:
        text = [line for line in lines if line.strip() and not line.lstrip().startswith("#") and "INVALID" not in line]
    readings = [found for line in text if (found := READING.search(line))]
    if len(readings) > len(text) / 2:
        return np.array([found.groups() for found in readings], dtype=float)
    mark, decimal = max(WAYS, key=lambda way: _numbers_in(text[len(text) // 2], *way)) if text else WAYS[0]
    text = [line.replace(",", ".") for line in text] if decimal == "," else text
    titles = [OF_UNIT.sub("", title.strip(' "\n')).lower() for title in text[0].split(mark)] if text else []
    if {"x", "y", "z"} <= set(titles):
        return np.loadtxt(text[1:], usecols=[titles.index(axis) for axis in "xyz"], delimiter=mark, ndmin=2)
    return np.loadtxt(text, usecols=(0, 1, 2), delimiter=mark, ndmin=2)


def _numbers_in(line: str, mark: str | None, decimal: str) -> int:
    """How many of a line's cells, so separated, are numbers."""
    cells = (cell.strip().replace(decimal, ".") for cell in line.split(mark))
    return sum(cell.lower() == "nan" or re.fullmatch(NUMBER, cell) is not None for cell in cells)


def _las(file: str) -> Float:
    laspy = library("laspy")
    with open(file, "rb") as header:
        records = int.from_bytes(header.read(104)[100:], "little")
    if records * LAS_RECORD_BYTES > os.path.getsize(file):  # laspy would read them one by one
        raise ValueError(f"{records} records of variable length are declared, which need more bytes than are there")
    with laspy.open(file) as reader:
        whole, points = reader.header.point_count, reader.read()
    if len(points) != whole:
        raise ValueError(f"{whole} points are declared, {len(points)} are there")
    return np.asarray(points.xyz)


def _e57(file: str) -> Float:
    """All scans, each placed by its own pose; points marked as invalid left out."""
    pye57 = library("pye57")

    scans = pye57.E57(file)
    found = [scans.read_scan(i, ignore_missing_fields=True) for i in range(scans.scan_count)]
    if not found:
        raise ValueError("it holds no scan")
    return np.concatenate([np.stack([scan[f"cartesian{k}"] for k in "XYZ"], axis=1) for scan in found])


READERS: dict[str, Callable[[str], Float]] = {
    ".ply": _point_cloud,
    ".pcd": _pcd,
    ".xyz": _table,
    ".txt": _table,
    ".asc": _table,
    ".csv": _table,
    ".stl": _mesh_vertices,
    ".obj": _mesh_vertices,
    ".las": _las,
    ".laz": _las,
    ".e57": _e57,
}


if __name__ == "__main__":
    sys.exit(main())
