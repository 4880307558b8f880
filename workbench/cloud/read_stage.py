"""`cloud.read`: a point cloud from the file of another scanner or program."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from workbench.artefacts import NO_NAMES, UNKNOWN_PART, PartNames, PointSet, frozen
from workbench.children import read_by
from workbench.cloud import readers
from workbench.cloud.readers import READERS
from workbench.cloud.units import MM, Unit, las_unit
from workbench.errors import InputError
from workbench.stage import InputFile, stage
from workbench.units import Float

OF_FORMAT: dict[str, Unit] = {".e57": "m"}  # ASTM E2807 says so; the others do not
IN_HEAD = re.compile(rb"\bunit:? (mm|m|inch)\b")  # as `export.cloud` says it where a format has no field for it
IN_TITLE = re.compile(rb"\bx\s*[\[(_]\s*(mm|m|inch)\b", re.IGNORECASE)  # of a table's column: X [mm], x_mm
LEAST_POINTS = 100
HEAD_BYTES = 4096  # that hold a header
LEAST_MM, MOST_MM = 12.0, 30_000.0  # longest side of a part's cloud: 300 mm in inches are refused
FAR_MM = 1e6  # no robot reaches a point a kilometre away
OPEN3D_SAYS = re.compile(r"\[Open3D (?:WARNING|ERROR)\]\s*(.*?)(?:\x1b\[0;m|$)", re.IGNORECASE | re.MULTILINE)
FORMATS = "PLY, PCD, XYZ (or txt, asc, csv), STL, OBJ, LAS, LAZ, E57"


@stage("cloud.read")
def read(
    *,
    file: InputFile,
    unit: Unit | None = None,
    part: PartNames = NO_NAMES,
) -> PointSet:
    """Read a cloud: PLY, PCD, XYZ (txt, asc, csv), STL or OBJ vertices (Open3D), LAS or LAZ (laspy), E57 (pye57).

    In the file's frame, precision and order; an organised PCD keeps rows and columns.
    NaN points are left out, and so are many at 0, 0, 0; scans of an E57 file are placed by their poses.

    Args:
        file: the cloud; the suffix of its name gives the format.
        unit: of the coordinates; null: by format (E57: m), reference system (LAS) or header, else mm, with a warning.
        part: part, operator and instruments, which cloud formats do not contain.

    Raises:
        InputError: an unknown or damaged file, no points, a map in another unit, or a size that no part
            has in the unit.

    Example:
        >>> from workbench import cloud
        >>> len(cloud.read(file="data/synthetic/milled_edge.laz").points_mm)
        174988
    """
    suffix = file.suffix.lower()
    if suffix not in READERS:
        raise InputError(str(file), f"expected a cloud as {FORMATS}, found the ending '{file.suffix}'")
    stated = unit or unit_stated(file)
    used: Unit = stated or "mm"
    points = in_process(file) * MM[used]
    told: tuple[str, ...] = ()
    if (lost := (points == 0.0).all(axis=1)).sum() > LEAST_POINTS:  # fewer may be a corner of a mesh
        points[lost], told = np.nan, (f"{file.name}: {lost.sum()} points at 0, 0, 0 are taken as no return",)
    seen = np.flatnonzero(~np.isnan(points).any(axis=1))
    rows, columns = grid_of(file) if suffix == ".pcd" else (0, 0)
    row, column = np.divmod(seen, columns) if rows > 1 and rows * columns == len(points) else (None, None)
    check_size(points[seen], used, str(file))
    told += () if stated else (_taken_for_granted(points[seen], file),)
    return PointSet(frozen(points[seen]), str(file), UNKNOWN_PART.with_names(part), row, column, told)


def unit_stated(file: Path) -> Unit | None:
    """What the format prescribes, a LAS file's reference system or the head says; None: nothing tells it.

    Raises:
        InputError: a LAS whose reference system has another unit, or tells none.
    """
    suffix = file.suffix.lower()
    if suffix in (".las", ".laz") and (unit := las_unit(file)):
        return unit
    with open(file, "rb") as stream:
        head = stream.read(HEAD_BYTES)
    said = IN_HEAD.search(head) or (IN_TITLE.search(head) if READERS.get(suffix) is READERS[".csv"] else None)
    return OF_FORMAT.get(suffix) or next((one for one in MM if said and one.encode() == said[1].lower()), None)


def grid_of(file: Path) -> tuple[int, int]:
    """(HEIGHT, WIDTH) of a PCD file by its header; (0, 0) where they are not told."""
    header, _ = readers.pcd_header(file)
    sizes = [(header.get(name) or [""])[0] for name in ("HEIGHT", "WIDTH")]
    rows, columns = (int(one) if one.isascii() and one.isdigit() and len(one) < 9 else 0 for one in sizes)
    return rows, columns


def in_process(file: Path) -> Float:
    """The file's points (n, 3), in its unit, read by a process of its own.

    Raises InputError with the reason where that process ends early, or where a library complains.
    """
    with read_by(readers.__file__, file, "points.npy") as (status, said, out):
        complaints = [text.strip() for text in OPEN3D_SAYS.findall(said) if "fail" in text.lower()]
        if status == 0 and not complaints:
            return np.asarray(np.load(out), dtype=np.float64).reshape(-1, 3)
        lines = said.strip().splitlines()
        why = complaints[-1] if complaints else lines[-1] if lines and status == 1 else "its reader crashed"
    why = why.removesuffix(f": {file.absolute()}").replace(str(file.absolute()), "it")
    raise InputError(str(file), f"expected a complete {file.suffix[1:].upper()} file: {why}")


def check_size(points_mm: Float, unit: Unit, where: str) -> None:
    """Refuse what cannot be the cloud of a part in this unit."""
    if len(points_mm) < LEAST_POINTS:
        raise InputError(where, f"expected a cloud of at least {LEAST_POINTS} points, found {len(points_mm)}")
    far = ~(np.abs(points_mm) < FAR_MM).all(axis=1)
    if far.any():
        at = int(far.argmax())
        place = ", ".join(f"{v:.6g}" for v in points_mm[at] / MM[unit])
        raise InputError(
            f"{where}: point {at + 1}",
            f"expected coordinates in {unit}, found ({place}), beyond 1 km: "
            f"{'is the unit another?' if unit != 'mm' else 'is it a point?'}",
        )
    size = _size(points_mm)
    if not LEAST_MM <= size <= MOST_MM:
        fits = fitting_units(points_mm / MM[unit])
        guess = f'; are its coordinates in {" or ".join(fits)}? Then say so: "unit"' if fits else ""
        raise InputError(
            where,
            f"expected a part of {LEAST_MM:g} mm to {MOST_MM / 1000:g} m, found one of "
            f"{size:.3g} mm with coordinates in {unit}{guess}",
        )


def fitting_units(points: Float) -> list[Unit]:
    """The units under which points (n, 3) as they stand in a file have the size of a part."""
    return [name for name in MM if LEAST_MM <= _size(points) * MM[name] <= MOST_MM]


def _taken_for_granted(points_mm: Float, file: Path) -> str:
    others = [unit for unit in fitting_units(points_mm) if unit != "mm"]
    fit = f"; in {' or '.join(others)} it would be the size of a part too" if others else ""
    return f'{file.name} states no unit: taken as mm, a part of {_size(points_mm):.3g} mm{fit} (state the "unit")'


def _size(points: Float) -> float:
    """The longest side of the box that holds all but the outermost of the points."""
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    return float((high - low).max())
