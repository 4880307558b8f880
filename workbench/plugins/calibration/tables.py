"""What calibrations from tables share: reading them, rows that all others contradict, what the result is good for.

Tables are small: CSV with a header, lines that begin with # are comments.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from workbench.api import DEG, Float, InputError, Int, numbered_lines, pose_from, read_text, rotation_from_quaternion

POSE = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")  # a flange in the base
JOINTS = tuple(f"q{k}_deg" for k in range(1, 7))
MAX_BYTES = 2**24
MOST = 1e6  # mm or degrees: beyond it lies nobody's cell
GROSS = 5.0  # standard deviations of a row, as the others say it lies: a blunder, by far
THREE_QUARTERS = 2.03  # quantile of the length of three standard normal numbers
ENOUGH = 0.5  # of the tolerance of the root face, that one link of the chain may take
MOST_GROSS = 0.25  # share of the rows; with more, nobody knows which are right
LEAST_FREEDOM = 4  # to tell a blunder from noise
NOISY = 2.0  # misfit that is told
MOST_MISFIT = 100.0  # residuals of ten times the stated noise: no noise, and no robot that errs a little
TOO_NEAR = 15.0  # times nearer to each other than the noise says: a length in inches is 25.4 times too small


class Table:
    """Rows of a CSV file by column name; every error names the line."""

    def __init__(self, path: Path, needed: Sequence[str], least: int) -> None:
        """Read `path`; InputError where a column of `needed` is missing or there are fewer than `least` rows."""
        self.path = path
        numbered = numbered_lines(read_text(path, MAX_BYTES))
        if not numbered:
            raise InputError(str(path), f"expected a header with the columns {', '.join(needed)}")
        self.header = [name.strip() for name in next(csv.reader([numbered[0][1]]))]
        missing = [name for name in needed if name not in self.header]
        if missing or len(set(self.header)) < len(self.header):
            what = f"expected the column '{missing[0]}'" if missing else "a column stands twice"
            raise InputError(f"{path}: header", what)
        self.lines = [line for line, _ in numbered[1:]]
        self._rows = [next(csv.reader([text])) for _, text in numbered[1:]]
        for line, row in zip(self.lines, self._rows, strict=True):
            if len(row) != len(self.header):
                raise InputError(f"{path}: line {line}", f"expected {len(self.header)} cells, found {len(row)}")
        if len(self._rows) < least:
            raise InputError(str(path), f"expected at least {least} rows, found {len(self._rows)}")

    def words(self, name: str, absent: str) -> list[str]:
        """A column of labels; `absent` in every row where the file has no such column."""
        if name not in self.header:
            return [absent] * len(self._rows)
        k = self.header.index(name)
        return [row[k].strip() or absent for row in self._rows]

    def labels(self, name: str, absent: str) -> tuple[tuple[str, ...], Int]:
        """The different labels of a column in the order in which they come, and the number (n,) of each row's."""
        words = self.words(name, absent)
        names = tuple(dict.fromkeys(words))
        return names, np.array([names.index(word) for word in words], np.int64)

    def numbers(self, names: Sequence[str], blank: bool = False) -> Float:
        """Columns (n, k) of finite numbers; NaN where a cell is empty, if `blank` allows it."""
        found = np.full((len(self._rows), len(names)), np.nan)
        for j, name in enumerate(names):
            if name not in self.header and blank:
                continue
            k = self.header.index(name)
            for i, (line, row) in enumerate(zip(self.lines, self._rows, strict=True)):
                if blank and not row[k].strip():
                    continue
                found[i, j] = self._number(row[k], f"{self.path}: line {line}: {name}")
        return found

    def _number(self, text: str, where: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= MOST:
            raise InputError(where, f"expected a number of at most {MOST:g}, found {text.strip()!r}")
        return value


def poses(table: Table) -> Float:
    """Poses (n, 4, 4) from the columns POSE; a quaternion of norm 1 within 1e-3 is normalised, another refused."""
    pose = table.numbers(POSE)
    norm = np.linalg.norm(pose[:, 3:], axis=1)
    for line, n in zip(table.lines, norm, strict=True):
        if not abs(n - 1.0) <= 1e-3:
            raise InputError(
                f"{table.path}: line {line}", f"expected a quaternion of norm 1 within 1e-3, found {n:.4g}"
            )
    return pose_from(rotation_from_quaternion(pose[:, 3:] / norm[:, None]), pose[:, :3])


class Found(Protocol):
    """A fit of some rows."""

    @property
    def distance(self) -> Float:
        """Of each row (n,) from the rest, in its standard deviations, as the length of three normal numbers."""

    @property
    def misfit(self) -> float:
        """Chi-square over degrees of freedom."""

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""


F = TypeVar("F", bound=Found)


def without_gross(
    count: int,
    solve: Callable[[Int], F],
    away_mm: Callable[[F, int], float],
    lines: tuple[int, ...],
    where: str,
    ask: str,
    spare: int = LEAST_FREEDOM,
    row_name: str = "line",
) -> tuple[F, Int, dict[int, str]]:
    """Leave out, one by one, the row that all others contradict most.

    More noise than stated is no blunder, and neither is what the model does not hold (gears, gravity): a row must be
    far off beside three quarters of *all* rows, those left out before counted as far off.

    Args:
        count: rows in all.
        solve: the fit of some rows (k,).
        away_mm: how far row i (of all) lies from where a fit without it puts it.
        lines: of the file, one a row.
        where: the file.
        ask: what may be wrong where too many rows contradict each other.
        spare: degrees of freedom that must be there to judge.
        row_name: what a number of `lines` counts.

    Returns: the fit, its rows, and by line of the file why one is left out.

    Raises:
        InputError: more blunders than can be told apart.
    """
    kept, left_out = np.arange(count), dict[int, str]()
    while True:
        found = solve(kept)
        worst = int(np.argmax(found.distance))
        all_ = np.concatenate([found.distance, np.full(len(left_out), np.inf)])
        usual = max(1.0, float(np.quantile(all_, 1.0 - MOST_GROSS, method="lower")) / THREE_QUARTERS)
        if found.freedom < spare or found.distance[worst] <= GROSS * usual:
            return found, kept, left_out
        if len(left_out) + 1 > MOST_GROSS * count:
            raise _contradictory(found, where, ask)
        row = int(kept[worst])
        kept = np.delete(kept, worst)
        line, away = lines[row], away_mm(solve(kept), row)
        left_out[line] = f"{row_name} {line} is left out: it lies {away:.2f} mm from where all other rows put it"


def check_misfit(found: Found, where: str, ask: str) -> None:
    """Refuse rows of which too many lie too far from what fits them best for any to be called a blunder."""
    if found.freedom >= LEAST_FREEDOM and found.misfit > MOST_MISFIT:
        raise _contradictory(found, where, ask)


def _contradictory(found: Found, where: str, ask: str) -> InputError:
    return InputError(where, f"the rows contradict each other: a misfit of {found.misfit:.0f} where 1 is usual; {ask}")


def enough(
    u_mm: float,
    bevel_deg: float,
    root_tolerance_mm: float,
    what: str,
    else_: str,
    turn: tuple[float, float] | None = None,
) -> tuple[bool, str]:
    """Whether an uncertainty across the bevel serves a tolerance of the root face, and the sentence that says so.

    A tool that stands off by u along the bevel's normal moves the root's end by u / sin(bevel). Uncertainties add as
    squares: one that takes up to half of the tolerance leaves 87 % of it to all others. `turn`: likewise, the
    uncertainty of a direction and the tolerance of the bevel angle, both in degrees.
    """
    expanded = 2.0 * u_mm / math.sin(bevel_deg * DEG)
    good = expanded <= ENOUGH * root_tolerance_mm
    takes = f"{what} alone takes U = {expanded:.3f} mm of a root face tolerance of ± {root_tolerance_mm:g} mm"
    if turn is not None:
        good = good and 2.0 * turn[0] <= ENOUGH * turn[1]
        takes += f" and {2.0 * turn[0]:.3f} deg of a bevel tolerance of ± {turn[1]:g} deg"
    return good, f"{takes}: {'good enough' if good else f'not good enough, more than half of it; {else_}'}"


def noisy(found: Found, what: str, ask: str) -> tuple[str, ...]:
    """A warning where the residuals are larger than the stated noise, or smaller by far."""
    if found.freedom < LEAST_FREEDOM:
        return ()
    if found.misfit < TOO_NEAR**-2:
        return (
            f"{what} lie more than {TOO_NEAR:g} times nearer to each other than the stated noise says: are positions "
            "in mm, and is each one measured by itself?",
        )
    if found.misfit <= NOISY:
        return ()
    return (
        f"{what} lie {math.sqrt(found.misfit):.1f} times as far apart as the stated noise says: the uncertainties "
        f"hold that; {ask}",
    )


def shared(place: Int, turn: Float, same: float) -> Float:
    """Rows (n,) that say the same as each row, itself included: of the same place (n,), turned by less than `same`.

    `turn` (n, n): between rows, rad. What is wrong in a posture is wrong in it however often it is written down, so
    that all rows of a posture weigh as much as one.
    """
    alike = (place[:, None] == place[None, :]) & (turn <= same)
    return np.asarray(alike.sum(axis=1), dtype=np.float64)


def studentised(white: Float, rows: Float, covariance: Float) -> Float:
    """Distance (n,) of each row's whitened residuals (n, 3) from the fit of the others; rows (n, 3, P) its Jacobian."""
    hat = np.einsum("nij,jk,nlk->nil", rows, covariance, rows)
    apart = np.linalg.pinv(np.eye(white.shape[1]) - hat, rcond=1e-6)
    size = np.einsum("ni,nij,nj->n", white, apart, white)
    return np.asarray(np.sqrt(np.maximum(size, 0.0) * 3.0 / white.shape[1]))
