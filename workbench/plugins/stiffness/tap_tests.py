"""Tap tests: frequency responses at the tool, from a list of tests (JSON) and files in UFF 58 or CSV."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from workbench.api import DEG, AnyArray, Float, InputError, Shaped, read_json, read_text
from workbench.plugins.table import MAX_BYTES, Table

LEAST_COHERENCE = 0.8  # of a line that is used
LEAST_LINES = 20  # used, of a response
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?")
UFF_KINDS = {8: "compliance", 11: "mobility", 12: "accelerance"}  # by the numerator's specific data type
UFF_DIRECTIONS = {1: "x", -1: "-x", 2: "y", -2: "-y", 3: "z", -3: "-z"}
Direction = Literal["x", "-x", "y", "-y", "z", "-z"]
Kind = Literal["compliance", "mobility", "accelerance"]
Six = tuple[float, float, float, float, float, float]


class TestPart(BaseModel):
    """One file of the list."""

    model_config = ConfigDict(extra="forbid")
    file: str
    joints_deg: Six
    point_mm: tuple[float, float, float] | None = None  # in the flange; null: the cutter's tip
    kind: Kind | None = None  # of a CSV: what a newton makes, in SI units
    axes: Literal["base", "flange"] = "base"


class TestsPart(BaseModel):
    """The list."""

    model_config = ConfigDict(extra="forbid")
    format: Literal["tap-tests"]
    version: Literal[1]
    tests: Annotated[list[TestPart], Field(min_length=1, max_length=100)]


class Response(NamedTuple):
    """A frequency response of one file."""

    hz: Shaped[Float, " n"]
    value: Shaped[AnyArray, " n"]  # complex, SI
    to: str  # direction of the response
    by: str  # of the force
    kind: str
    coherence: Shaped[Float, " n"] | None


@dataclass(frozen=True, slots=True, eq=False)
class TapTests:
    """Lines of all responses, as compliances; n of them at p postures."""

    source: str
    joints: Shaped[Float, "p 6"]
    point_mm: Shaped[Float, "p 3"]  # in the flange
    posture: Shaped[AnyArray, " n"]
    hz: Shaped[Float, " n"]
    value: Shaped[AnyArray, " n"]  # complex, m/N
    to: Shaped[Float, "n 3"]  # unit, base or flange axes as `in_flange` says
    by: Shaped[Float, "n 3"]
    in_flange: Shaped[AnyArray, " p"]
    left_out: int  # lines of too low a coherence


def read_tap_tests(path: Path, tip_mm: Float, band_hz: tuple[float, float]) -> TapTests:
    """Tests of a list; raises InputError with the file and the place, what was expected and the likeliest cause."""
    try:
        listed = TestsPart.model_validate(read_json(path))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: $.{place}", f"expected a list of tap tests: {first['msg']}") from None
    rows, left_out = [], 0
    for k, test in enumerate(listed.tests):
        file = path.parent / test.file
        for one in read_responses(file, test.kind):
            used = (one.hz >= band_hz[0]) & (one.hz <= band_hz[1]) & (np.abs(one.value) > 0)
            if one.coherence is not None:
                left_out += int((used & (one.coherence < LEAST_COHERENCE)).sum())
                used &= one.coherence >= LEAST_COHERENCE
            if used.sum() < LEAST_LINES:
                raise InputError(
                    str(file),
                    f"the response {one.to} by {one.by} has {used.sum()} lines from {band_hz[0]:g} to {band_hz[1]:g} "
                    f"Hz with a coherence of {LEAST_COHERENCE} or more: expected at least {LEAST_LINES}; strike "
                    "harder, with a softer tip, and average more",
                )
            power = {"compliance": 0, "mobility": 1, "accelerance": 2}[one.kind]
            value = one.value[used] / (2j * np.pi * one.hz[used]) ** power
            ways = np.repeat([[unit_vector(one.to)], [unit_vector(one.by)]], len(value), axis=1)
            rows.append((np.full(len(value), k), one.hz[used], value, *ways))
    posture, hz, value, to, by = (np.concatenate(column) for column in zip(*rows, strict=True))
    return TapTests(
        source=str(path),
        joints=np.array([test.joints_deg for test in listed.tests]) * DEG,
        point_mm=np.array([tip_mm if test.point_mm is None else test.point_mm for test in listed.tests], float),
        posture=posture,
        hz=hz,
        value=value,
        to=to,
        by=by,
        in_flange=np.array([test.axes == "flange" for test in listed.tests]),
        left_out=left_out,
    )


def unit_vector(direction: str) -> Float:
    """Of an axis as `x` or `-x` name it."""
    return np.asarray((-1.0 if direction[0] == "-" else 1.0) * np.eye(3)["xyz".index(direction[-1])])


def read_responses(path: Path, kind: str | None) -> list[Response]:
    """All frequency responses of a file, UFF 58 by its content, else CSV."""
    text = read_text(path, MAX_BYTES)
    found = _uff(path, text) if text.lstrip().startswith("-1") else _csv(path, text, kind)
    if not found:
        raise InputError(str(path), "expected frequency responses, found none")
    for one in found:
        if len(one.hz) < 2 or not (np.diff(one.hz) > 0).all() or not np.isfinite(one.value).all():
            raise InputError(str(path), f"the response {one.to} by {one.by}: expected finite lines of rising frequency")
    return found


def _csv(path: Path, text: str, kind: str | None) -> list[Response]:
    """Columns hz, then for each response as xy_re, xy_im and, where known, xy_coherence: x by a force along y."""
    if kind is None:
        raise InputError(str(path), "expected its kind in the list: compliance, mobility or accelerance, in SI units")
    table = Table(path, ("hz",), 0, text)
    pairs = [name[:2] for name in table.header if re.fullmatch(r"[xyz][xyz]_re", name)]
    missing = [f"{pair}_im" for pair in pairs or ["xx"] if f"{pair}_im" not in table.header]
    if missing:
        raise InputError(f"{path}: header", f"expected hz and columns as xx_re, xx_im; '{missing[0]}' is missing")
    (hz,), found = table.numbers(("hz",)).T, []
    for pair in pairs:
        real, imaginary = table.numbers((f"{pair}_re", f"{pair}_im")).T
        known = table.numbers((f"{pair}_coherence",))[:, 0] if f"{pair}_coherence" in table.header else None
        found.append(Response(hz, real + 1j * imaginary, pair[0], pair[1], kind, known))
    return found


def _uff(path: Path, text: str) -> list[Response]:
    """Datasets 58 of frequency responses (function type 4) with their coherences (type 6), ASCII, SI units.

    As the Universal File Format's data set 58 has it (SDRC): eleven records of text, then the ordinates.
    """
    responses: list[tuple[int, Response]] = []
    coherences: dict[int, Float] = {}
    lines = text.splitlines()
    marks = [k for k, line in enumerate(lines) if line.strip() == "-1"]
    if len(marks) % 2:
        raise InputError(f"{path}: line {marks[-1] + 1}", "a data set that does not end: expected a line with -1")
    for at, end in zip(marks[::2], marks[1::2], strict=True):
        name = lines[at + 1].split()[:1]
        if name == ["58b"]:
            raise InputError(f"{path}: line {at + 2}", "a binary data set 58b: expected ASCII; export it as UFF ASCII")
        if name == ["58"]:
            _data_set(path, lines[at + 2 : end], at + 3, responses, coherences)
    return [one._replace(coherence=coherences.get(point)) for point, one in responses]


def _data_set(
    path: Path, lines: list[str], first: int, responses: list[tuple[int, Response]], coherences: dict[int, Float]
) -> None:
    if len(lines) < 12:
        raise InputError(f"{path}: line {first}", "expected eleven records and data in a data set 58")
    try:
        what = _integers(lines[5])
        function, to, by = what[0], int(lines[5][51:55] or 0), int(lines[5][76:80] or 0)
        form, count, even = _integers(lines[6])[:3]
        start, step = _numbers(lines[6][30:])[:2]
        numerator, denominator = int(lines[8].split()[0]), int(lines[9].split()[0])
    except (ValueError, IndexError):
        raise InputError(f"{path}: line {first + 5}", "expected records 6 to 10 of a data set 58") from None
    if function not in (4, 6):
        return
    numbers = _numbers(" ".join(lines[11:]))
    width = (1 if form in (2, 4) else 2) + (even == 0)
    if form not in (2, 4, 5, 6) or len(numbers) != width * count:
        where = f"{path}: line {first + 11}"
        raise InputError(where, f"expected {width * count} numbers, found {len(numbers)}: is the file cut off?")
    table = numbers.reshape(count, width)
    hz = table[:, 0] if even == 0 else start + step * np.arange(count)
    value = table[:, even == 0 :] if form in (2, 4) else table[:, -2] + 1j * table[:, -1]
    place = abs(to) * 10 + abs(by)
    if function == 6:
        coherences[place] = np.real(value).ravel()
        return
    if numerator not in UFF_KINDS or denominator != 13 or to not in UFF_DIRECTIONS or by not in UFF_DIRECTIONS:
        raise InputError(
            f"{path}: line {first + 5}",
            "expected displacement, velocity or acceleration (8, 11, 12) by force (13), along x, y or z (1 to 3); "
            f"found {numerator} by {denominator}, directions {to}, {by}",
        )
    kind = UFF_KINDS[numerator]
    one = Response(np.asarray(hz), np.ravel(value), UFF_DIRECTIONS[to], UFF_DIRECTIONS[by], kind, None)
    responses.append((place, one))


def _numbers(line: str) -> Float:
    return np.array(NUMBER.findall(line.upper().replace("D", "E")), float)


def _integers(line: str) -> list[int]:
    return [int(one) for one in line.split() if re.fullmatch(r"[-+]?\d+", one)]
