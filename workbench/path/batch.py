"""What the parts of a batch have in common: a running mean along the edge of how first cuts lie beside their plan.

Part k shows d = r + p + g + e at each station: r repeats from part to part; p is that part's own, as wrong as its
plan's scan, and both of its passes show it; g the robot does not repeat; e is the measurement's. The finishing pass
asks for r + p. Of n earlier parts with mean m, a Kalman filter's prediction of it is m, of variance V = (P + G) / n + P
with P and G the variances of p and of g + e; this part's own d has variance G, so the gain is K = V / (V + G), and the
estimate m + K (d - m) has K G (R. E. Kalman, J. Basic Eng. 82, 1960, 35). P is told by how far parts lie from the
mean of those before them, beyond G.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from workbench.artefacts import Batch, Toolpath
from workbench.errors import InputError
from workbench.geometry.moves import within
from workbench.path.displacement import Prior
from workbench.path.plan import KEY_POINT_MM
from workbench.units import DEG, Float, Shaped

MAX_BYTES = 2**26
SAME_MM, SAME_DEG = 2.0, 0.01  # by which plans of one drawing may differ in length and allowance, and in the bevel
SURE = math.erf(3.0 / math.sqrt(2.0))  # a cut that is farther from the others than chance makes it so often is another


def known_batch(path: Path, toolpath: Toolpath) -> Batch:
    """The batch so far, out of the correction.json of the part before.

    Raises:
        InputError: not such a file; parts of another length, bevel or allowance.
    """
    from workbench.result_files.contract import (
        CorrectionFile,  # the models take time to build: where there is something to read
    )

    file = CorrectionFile.read(path, MAX_BYTES)
    if file.batch is None:
        raise InputError(f"{path}: $.batch", "expected a correction.json that says what its batch showed")
    for name, said, here, most in (
        ("length_mm", file.batch.length_mm, toolpath.edge_length_mm, SAME_MM),
        ("bevel_deg", file.batch.bevel_deg, toolpath.bevel_deg, SAME_DEG),
        ("allowance_mm", file.allowance_mm, toolpath.finish_allowance_mm, SAME_DEG),
    ):
        if abs(said - here) > most:
            raise InputError(f"{path}: {name}", f"expected the same first path, {here:g}, found {said:g}")
    rows = file.stations
    columns = [
        [math.nan if value is None else value for value in column]
        for column in (
            [row.batch_displacement_mm for row in rows],
            [row.batch_tilt_deg for row in rows],
        )
    ]
    arc = np.array([row.arc_length_mm for row in rows])
    shift, turn = (math.nan if one is None else one for one in (file.batch.scatter_mm, file.batch.scatter_deg))
    return Batch(file.batch.parts, arc, np.array(columns[0]), np.array(columns[1]) * DEG, shift, turn * DEG)


class Together(NamedTuple):
    """The values of all parts at n places, the share of their scatter that is left, and how parts differ so far."""

    values: Shaped[Float, " n"]
    share: float = 1.0
    scatter: float = math.nan  # standard deviation of one part's values about the batch's, NaN: not known yet
    doubt: bool = False  # the part is another than those before it: they do not count


def together(values: Float, u: Float, prior: Prior, n: int, mean: Float, scatter: float) -> Together:
    """A part's values and the mean (n,) of those before it, weighed as the module says.

    P is what parts differ by beyond what robot and measurement make of it, by all parts so far.

    Args:
        values: (n,) what the places of this part's cut show of one displacement.
        u: (n,) local standard uncertainties.
        prior: of the displacement.
        n: number of parts before.
        mean: (n,) of them there; NaN: they showed nothing.
        scatter: of them, NaN: not known.
    """
    known, own = np.isfinite(mean), prior.unrepeated**2 + float(np.median(u)) ** 2
    if known.mean() < 0.5 or own == 0.0:
        return Together(values)
    off, more = np.where(known, values - mean, 0.0), 1.0 + 1.0 / n
    square = float(np.mean(off[known] ** 2)) / more
    # Along one edge a smooth error may be no more than one value: of n, n - 1 tell how far a next one may be.
    if np.isfinite(scatter) and square > max(scatter**2, own) * scipy.special.fdtri(1.0, n - 1.0, SURE):
        return Together(values, doubt=True)
    square = ((n - 1) * scatter**2 + square) / n if np.isfinite(scatter) else square
    part = max(square - own, 0.0)
    ahead = (part + own) / n + part
    gain = ahead / (ahead + own)
    return Together(values - (1.0 - gain) * off, math.sqrt(gain), math.sqrt(square))


def with_part(batch: Batch | None, at: Float, s: Float, parts: Sequence[tuple[Float, Together]]) -> Batch:
    """The batch with one part more: measured values (n,) of shift and tilt at places `s`, for stations `at` (k,)."""
    order = np.argsort(s)
    far = ~within(at, s, 2.0 * KEY_POINT_MM)
    new = [np.where(far, np.nan, np.interp(at, s[order], values[order])) for values, _ in parts]
    scatter = [one.scatter for _, one in parts]
    if batch is None:
        return Batch(1, at, new[0], new[1])
    n, before = batch.parts, batch.on(at)
    made = [
        np.where(np.isnan(mean), value, np.where(np.isnan(value), mean, (n * mean + value) / (n + 1)))
        for value, mean in zip(new, (before.shift_mm, before.turn), strict=True)
    ]
    return Batch(n + 1, at, made[0], made[1], scatter[0], scatter[1])
