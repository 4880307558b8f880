"""`compare.reference_fits`: the fits of this program against reference data sets with known answers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench import pieces
from workbench.artefacts import Chapter, Document
from workbench.errors import InputError
from workbench.geometry.fits import Fit, Shape, fit
from workbench.stage import InputFile, stage
from workbench.storage import numbered_lines, read_text
from workbench.strict_json import strict_json
from workbench.units import Float


@stage("compare.reference_fits")
def reference_fits(
    *,
    points: Annotated[list[InputFile], Field(min_length=1)],
    answers: list[InputFile] = [],  # noqa: B006  (checked and copied before the function sees it)
    shape: Shape,
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 1e-9,
) -> tuple[Document, Chapter]:
    """Fit reference data sets and compare with their reference answers, as NIST's algorithm testing does.

    An answer's numbers: a point of line, plane or axis, or a centre; the direction where there is one; last the
    *diameter* where there is one. Errors are of the radius, of the distance between the shapes at the data's centroid,
    and of the direction over the size.

    Args:
        points: data sets (.ds): x y z in mm, one point a line.
        answers: their reference answers (.fit), in the same order; none: only fit.
        shape: what they are points of: line, plane, circle, sphere or cylinder.
        tolerance: largest error that passes, as a share of the shape's size (the data's extent, or the radius where
            that is larger).

    Raises:
        InputError: unreadable, another count of numbers, points that leave the shape open.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from workbench import compare
        >>> file = Path(tempfile.mkdtemp()) / "octahedron.ds"
        >>> file.write_text("1 0 0\\n-1 0 0\\n0 1 0\\n0 -1 0\\n0 0 1\\n0 0 -1\\n")
        39
        >>> document, chapter = compare.reference_fits(points=[file], shape="sphere")
        >>> document.name, chapter.title
        ('reference_fits.json', 'Reference fits')
    """
    if answers and len(answers) != len(points):
        raise InputError(
            "compare.reference_fits.answers", f"expected {len(points)} files, one a data set, found {len(answers)}"
        )
    rows = []
    for k, path in enumerate(points):
        data = read_points(path)
        try:
            found = fit(shape, data)
        except ValueError as error:
            raise InputError(str(path), str(error)) from None
        errors = _errors(found, read_answer(answers[k], shape), data) if answers else {}
        rows.append(
            {
                "points": str(path),
                "answer": str(answers[k]) if answers else None,
                "count": len(data),
                **_found(found),
                **errors,
            }
        )
    return _document(shape, tolerance, rows), _chapter(shape, tolerance, rows)


def _found(found: Fit) -> dict[str, object]:
    diameter = None if found.radius_mm is None else 2 * found.radius_mm
    return {"point_mm": found.point_mm, "direction": found.direction, "diameter_mm": diameter, "rms_mm": found.rms_mm}


def _errors(found: Fit, answer: Float, data: Float) -> dict[str, float]:
    """Errors in mm, and the largest as a share of the size."""
    size = max(float(np.ptp(data, axis=0).max()), found.radius_mm or 0.0)
    off, direction = found.point_mm - answer[:3], None if found.direction is None else answer[3:6]
    errors = {
        "radius_error_mm": 0.0 if found.radius_mm is None else found.radius_mm - 0.5 * float(answer[-1]),
        "direction_error": 0.0,
    }
    if direction is not None and found.direction is not None:
        direction = direction / np.linalg.norm(direction)
        errors["direction_error"] = float(np.linalg.norm(np.cross(found.direction, direction)))
        if found.shape == "plane":
            off = direction * (off @ direction)
        elif found.shape in ("line", "cylinder"):
            off = off - direction * (off @ direction)
    errors["position_error_mm"] = float(np.linalg.norm(off))
    worst = max(abs(errors["radius_error_mm"]), errors["position_error_mm"], errors["direction_error"] * size)
    return {**errors, "relative_error": worst / size}


def _document(shape: Shape, tolerance: float, rows: list[dict[str, object]]) -> Document:
    content = {"format": "reference-fits", "version": 1, "shape": shape, "tolerance": tolerance, "fits": rows}
    return Document("reference_fits.json", strict_json(content))


def _chapter(shape: Shape, tolerance: float, rows: list[dict[str, object]]) -> Chapter:
    errors = [float(str(row["relative_error"])) for row in rows if "relative_error" in row]
    passed = sum(error <= tolerance for error in errors)
    words = (
        f"{len(rows)} {shape} fits"
        if not errors
        else f"{passed} of {len(rows)} {shape} fits within {tolerance:g} of their size; worst {max(errors):.1e}"
    )
    table = pieces.table_html(
        ("Data set", "Points", "RMS residual, mm", "Relative error"),
        [
            (
                Path(str(row["points"])).name,
                str(row["count"]),
                f"{float(str(row['rms_mm'])):.3g}",
                f"{float(str(row['relative_error'])):.1e}" if "relative_error" in row else "–",
            )
            for row in rows
        ],
    )
    return Chapter("Reference fits", table, summary=f"{words}.")


# Reference data sets as NIST hands them out: points (`.ds`) and answers (`.fit`), plain numbers.

MAX_BYTES = 2**28
NUMBERS: dict[Shape, tuple[int, str]] = {
    "line": (6, "a point and the direction"),
    "plane": (6, "a point and the normal"),
    "circle": (7, "centre, normal and diameter"),
    "sphere": (4, "centre and diameter"),
    "cylinder": (7, "a point of the axis, its direction and the diameter"),
}


def read_points(path: Path) -> Float:
    """Points (n, 3): three numbers a line, blanks or commas between; lines that begin with # are comments.

    Raises:
        InputError: unreadable, no numbers; with the line.
    """
    lines = numbered_lines(read_text(path, MAX_BYTES))
    rows = [_numbers(line, f"{path}: line {k}") for k, line in lines]
    for (k, _), row in zip(lines, rows, strict=True):
        if len(row) != 3:
            raise InputError(f"{path}: line {k}", f"expected three numbers, found {len(row)}")
    if not rows:
        raise InputError(str(path), "expected points, found none")
    return np.array(rows)


def read_answer(path: Path, shape: Shape) -> Float:
    """The numbers of an answer, in any lines; a direction need not be a unit vector.

    Raises:
        InputError: another count of numbers than the shape has, no direction, no diameter.
    """
    lines = numbered_lines(read_text(path, MAX_BYTES))
    values = np.array([value for k, line in lines for value in _numbers(line, f"{path}: line {k}")])
    count, words = NUMBERS[shape]
    if len(values) != count:
        raise InputError(str(path), f"expected {count} numbers for a {shape}, {words}, found {len(values)}")
    if count > 4 and not np.linalg.norm(values[3:6]) > 0:
        raise InputError(str(path), "expected a direction, found zero")
    if count != 6 and not values[-1] > 0:
        raise InputError(str(path), f"expected a diameter above 0, found {values[-1]:g}")
    return values


def _numbers(line: str, where: str) -> list[float]:
    values = []
    for word in line.replace(",", " ").split():
        try:
            value = float(word)
        except ValueError:
            value = np.inf
        if not np.isfinite(value) or "_" in word:
            raise InputError(where, f"expected finite numbers, found '{word[:40]}'")
        values.append(value)
    return values
