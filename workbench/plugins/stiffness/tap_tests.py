"""Tap tests: frequency responses at the tool, from a list of tests (JSON) and their files in CSV."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from workbench.api import DEG, AnyArray, Float, InputError, Shaped, parsed, read_json
from workbench.plugins.csv_table import Table
from workbench.plugins.stiffness.values import Six

LEAST_COHERENCE = 0.8  # of a line that is used
LEAST_LINES = 20  # used, of a response
Kind = Literal["compliance", "mobility", "accelerance"]


class TestPart(BaseModel):
    """One file of the list."""

    model_config = ConfigDict(extra="forbid")
    file: str
    joints_deg: Six
    point_mm: tuple[float, float, float] | None = None  # in the flange; null: the cutter's tip
    kind: Kind  # what a newton makes, in SI units
    axes: Literal["base", "flange"] = "base"


class TestsPart(BaseModel):
    """The list."""

    model_config = ConfigDict(extra="forbid")
    format: Literal["tap-tests"]
    version: Literal[1]
    tests: Annotated[list[TestPart], Field(min_length=1, max_length=100)]


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
    listed = parsed(TestsPart, read_json(path), f"{path}: $")
    rows, left_out = [], 0
    for k, test in enumerate(listed.tests):
        file = path.parent / test.file
        for pair, every_hz, response, coherence in read_responses(file):
            used = (every_hz >= band_hz[0]) & (every_hz <= band_hz[1]) & (np.abs(response) > 0)
            left_out += int((used & (coherence < LEAST_COHERENCE)).sum())
            used &= coherence >= LEAST_COHERENCE
            if used.sum() < LEAST_LINES:
                raise InputError(
                    str(file),
                    f"the response {pair[0]} by {pair[1]} has {used.sum()} lines from {band_hz[0]:g} to "
                    f"{band_hz[1]:g} Hz with a coherence of {LEAST_COHERENCE} or more: expected at least "
                    f"{LEAST_LINES}; strike harder, with a softer tip, and average more",
                )
            power = {"compliance": 0, "mobility": 1, "accelerance": 2}[test.kind]
            value = response[used] / (2j * np.pi * every_hz[used]) ** power
            ways = np.repeat([[unit_vector(pair[0])], [unit_vector(pair[1])]], len(value), axis=1)
            rows.append((np.full(len(value), k), every_hz[used], value, *ways))
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


def read_responses(path: Path) -> Iterator[tuple[str, Float, AnyArray, Float]]:
    """Responses of a CSV: columns hz, xy_re, xy_im (x by a force along y) and, where known, xy_coherence, else 1.

    Which one, Hz, values and coherences (n,).
    """
    table = Table(path, ("hz",), 2)
    pairs = [name[:2] for name in table.header if re.fullmatch(r"[xyz][xyz]_re", name)]
    missing = [f"{pair}_im" for pair in pairs if f"{pair}_im" not in table.header] if pairs else ["xx_re"]
    if missing:
        raise InputError(f"{path}: header", f"expected hz and columns as xx_re, xx_im; '{missing[0]}' is missing")
    hz = table.numbers(("hz",))[:, 0]
    if not (np.diff(hz) > 0).all():
        raise InputError(str(path), "expected lines of rising frequency")
    for pair in pairs:
        real, imaginary = table.numbers((f"{pair}_re", f"{pair}_im")).T
        name = f"{pair}_coherence"
        coherence = table.numbers((name,), blank=name not in table.header)[:, 0]
        yield pair, hz, real + 1j * imaginary, np.nan_to_num(coherence, nan=1.0)
