"""Height maps: images (TIFF by tifffile, PNG by Pillow) whose rows are profiles, with the pitches of the mapping."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.importing.files import claims
from workbench.importing.grid import bounded, without
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_tables import LENGTH_MM
from workbench.importing.neutral import Imported, ProfileFrames
from workbench.scan.trial import survives
from workbench.units import AnyArray, Float

NAME = "height map (TIFF, PNG)"
MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"\x89PNG\r\n\x1a\n")
MOST_PIXELS = 400_000_000
MOST_RATIO = 2000  # pixels a byte of the file: deflate reaches 1,032 bytes a byte


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it begins as a TIFF or PNG does."""
    return head.startswith(MAGIC)


def read(path: Path, mapping: Mapping) -> Imported:
    """One surface: a row a profile, the way along the scan from row to row.

    Raises:
        InputError: not a whole image of one number a pixel; no pitches in the mapping.
    """
    values = pixels(path)
    part = mapping.height_map
    if part is None or not (part.files is None or claims(part, path)):
        raise InputError(
            str(path),
            f"a height map of {values.shape[0]} x {values.shape[1]} ({values.dtype}): expected 'height_map' in the "
            "mapping with x_pitch, y_pitch and z_scale (workbench import --draft writes one)",
        )
    unit = LENGTH_MM[part.length_unit]
    heights: Float = without(values.astype(np.float64), part.missing)
    z_mm = bounded((heights * part.z_scale + part.z_offset) * unit)
    rows, columns = values.shape
    x_mm = np.broadcast_to(bounded(np.arange(float(columns)) * part.x_pitch * unit), z_mm.shape)
    note = f"{NAME}: {rows} rows of {columns}, {values.dtype}; {part.z_scale:g} {part.length_unit} a count"
    travel: Float = np.arange(float(rows)) * part.y_pitch * unit
    frames = ProfileFrames(str(path), np.asarray(x_mm), z_mm, travel_mm=travel, length_unit=part.length_unit)
    return Imported(profiles=frames, notes=(note,))


def pixels(path: Path) -> AnyArray:
    """The image (rows, columns); InputError where it is none, or one of several numbers a pixel."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        is_png = file.read(4) == MAGIC[-1][:4]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = (_png if is_png else _tiff)(path, size)
    except InputError:
        raise
    except Exception as error:  # whatever a library makes of a damaged file
        raise InputError(str(path), f"expected a whole image: {str(error)[:120] or type(error).__name__}") from None
    values = np.squeeze(values)
    if values.ndim != 2 or values.dtype.kind not in "iuf" or min(values.shape) < 2:
        raise InputError(str(path), f"expected one number a pixel, found shape {values.shape} of {values.dtype}")
    return values


def _tiff(path: Path, size: int) -> AnyArray:
    import tifffile

    def shape() -> object:
        with tifffile.TiffFile(path) as file:
            return file.series[0].shape

    if not survives(shape):  # directories that lead round in a damaged file
        raise InputError(str(path), "expected a whole image: its directories do not come to an end")
    with tifffile.TiffFile(path) as file:
        series = file.series[0]
        _check_size(path, int(np.prod(series.shape)), size)
        return np.asarray(series.asarray())


def _png(path: Path, size: int) -> AnyArray:
    from PIL import Image

    with Image.open(path) as image:
        _check_size(path, image.width * image.height, size)
        return np.asarray(image)


def _check_size(path: Path, count: int, size: int) -> None:
    if not 0 < count <= min(MOST_PIXELS, MOST_RATIO * size):
        raise InputError(str(path), f"expected at most {MOST_PIXELS} pixels, found {count} in {size} bytes")


def drafted(path: Path) -> tuple[dict[str, Any], list[str]]:
    """The part `height_map` for an image, and what is uncertain of it."""
    values = pixels(path)
    whole = values.dtype.kind in "iu"
    part: dict[str, Any] = {"x_pitch": 1.0, "y_pitch": 1.0, "z_scale": 0.001 if whole else 1.0}
    doubts = ["height_map.x_pitch, height_map.y_pitch: an image does not tell them; 1 mm stands for the sensor's"]
    lowest = values.min() if whole else np.nanmin(values)
    codes = [float(lowest)] if (values == lowest).mean() > 1e-3 else []
    if codes != [0.0]:
        part["missing"] = codes
    if whole:
        doubts.append("height_map.z_scale: counts do not tell their size; 0.001 mm stands for the sensor's")
    if codes:
        doubts.append(f"height_map.missing: {codes[0]:g}, the least value, is taken as no return")
    return part, doubts
