"""Height maps: images (TIFF by tifffile, PNG by Pillow) and numpy's .npy whose rows are profiles.

Heights alone: the pitches are the mapping's.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from workbench.errors import InputError
from workbench.importing import arrays
from workbench.importing.mapping import Mapping, claims
from workbench.importing.mapping_parts import LENGTH_MM
from workbench.importing.neutral import Imported, ProfileFrames, bounded, without
from workbench.scan.hdf5 import survives
from workbench.units import AnyArray, Float

NAME = "height map (TIFF, PNG, .npy)"
MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"\x89PNG\r\n\x1a\n")
MOST_PIXELS = 400_000_000
METRES_SPAN = 0.5  # of heights: less is a plate within half a millimetre, or one in metres
MOST_RATIO = 2000  # pixels a byte of the file: deflate reaches 1,032 bytes a byte


def recognises(path: Path, head: bytes, mapping: Mapping) -> bool:
    """Whether it begins as a TIFF or PNG does, or is a single array of heights."""
    numpy = head.startswith(arrays.MAGIC)
    return head.startswith(MAGIC) or (numpy and (claims(mapping.height_map, path) or arrays.is_height_map(path)))


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
    """The image or array (rows, columns); InputError where it is none, or one of several numbers a pixel."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        start = file.read(4)
    form = {MAGIC[-1][:4]: _png, arrays.MAGIC[:4]: _numpy}.get(start, _tiff)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = form(path, size)
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


def _numpy(path: Path, size: int) -> AnyArray:
    values = np.load(path, mmap_mode="r", allow_pickle=False)
    _check_size(path, values.size, size)
    return np.array(values)


def _check_size(path: Path, count: int, size: int) -> None:
    if not 0 < count <= min(MOST_PIXELS, MOST_RATIO * size):
        raise InputError(str(path), f"expected at most {MOST_PIXELS} pixels, found {count} in {size} bytes")


def drafted(path: Path) -> tuple[dict[str, Any], list[str]]:
    """The part `height_map` for an image, and what is uncertain of it."""
    values = pixels(path)
    whole = values.dtype.kind in "iu"
    part: dict[str, Any] = {"x_pitch": 1.0, "y_pitch": 1.0, "z_scale": 0.001 if whole else 1.0}
    doubts = ["height_map.x_pitch, height_map.y_pitch: an image does not tell them; 1 mm stands for the sensor's"]
    lowest = values.min() if whole else np.nanmin(values, initial=np.inf)
    codes = [float(lowest)] if (values == lowest).mean() > 1e-3 else []
    if codes != [0.0]:
        part["missing"] = codes
    if whole:
        doubts.append("height_map.z_scale: counts do not tell their size; 0.001 mm stands for the sensor's")
    else:
        seen = values[np.isfinite(values) & ~np.isin(values, codes)]
        span = float(np.ptp(seen)) if len(seen) else 0.0
        unit, part["z_scale"] = ("m", 1000.0) if 0.0 < span < METRES_SPAN else ("mm", 1.0)
        doubts.append(f"height_map.z_scale: heights are taken as {unit}, by their span of {span:.4g}")
    if codes:
        doubts.append(f"height_map.missing: {codes[0]:g}, the least value, is taken as no return")
    return part, doubts
