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
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from workbench.artefacts import Batch, Toolpath
from workbench.errors import InputError
from workbench.geometry.moves import within
from workbench.geometry.poses import rotation_from_quaternion
from workbench.path.displacement import Prior
from workbench.path.plan import KEY_POINT_MM
from workbench.units import DEG, Float, Shaped

if TYPE_CHECKING:
    from workbench.result_files.contract import BatchRow

MAX_BYTES = 2**26
SAME_MM, SAME_DEG = 2.0, 0.01  # by which plans of one drawing may differ in length and allowance, and in the bevel
TURNED_DEG, AWAY_MM = 5.0, 100.0  # by which a part may stand elsewhere than those before it
SURE = math.erf(3.0 / math.sqrt(2.0))  # a cut that is farther from the others than chance makes it so often is another


def known_batch(path: Path, toolpath: Toolpath) -> Batch:
    """The batch so far, out of the correction.json of the part before.

    Raises:
        InputError: not such a file; parts of another length, bevel or allowance, at another place, of another robot or
            cutter; this part among them.
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
    _check_alike(file.batch, shared_by(toolpath, ()), f"{path}: $.batch")
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
    shared = {name: getattr(file.batch, name) for name in shared_by(toolpath, ())}
    return Batch(file.batch.parts, arc, np.array(columns[0]), np.array(columns[1]) * DEG, shift, turn * DEG, shared)


def shared_by(toolpath: Toolpath, before: Sequence[str]) -> dict[str, Any]:
    """What parts of a batch have in common, by this one's path; before: the ids of those before it."""
    layer, part = toolpath.layers[-1], toolpath.part
    middle = [len(layer.arc_length_mm) // 2]
    normal = -rotation_from_quaternion(layer.quaternion_wxyz[middle])[0, :, 0]
    if toolpath.base_from_workobject is not None:
        normal = toolpath.base_from_workobject[:3, :3] @ normal
    return {
        "part_ids": [*before, *([part.part_id] if part.part_id else [])],
        "place_mm": toolpath.in_base(layer.position_mm[middle])[0].tolist(),
        "normal": normal.tolist(),
        "cutter_diameter_mm": toolpath.cutter.diameter_mm,
        "robot": part.robot,
        "robot_serial": part.robot_serial,
    }


def _check_alike(before: BatchRow, here: Mapping[str, Any], where: str) -> None:
    """Refuse parts whose errors need not be this one's: those of tool, robot and hand-eye are fixed in the base."""
    if here["part_ids"] and here["part_ids"][0] in before.part_ids:
        raise InputError(
            f"{where}.part_ids", f"'{here['part_ids'][0]}' is one of the parts before: it would count twice"
        )
    for name in ("robot", "robot_serial", "cutter_diameter_mm"):
        said, own = getattr(before, name), here[name]
        if said is not None and own is not None and said != own:
            raise InputError(f"{where}.{name}", f"expected parts of the same, {own}, found {said}: begin a new batch")
    if before.place_mm is None or before.normal is None:
        return
    turned = math.degrees(math.acos(min(1.0, float(np.dot(before.normal, here["normal"])))))
    away = float(np.linalg.norm(np.subtract(before.place_mm, here["place_mm"])))
    if turned > TURNED_DEG or away > AWAY_MM:
        raise InputError(
            where,
            f"the parts before stood {away:.0f} mm away, and turned by {turned:.0f} deg, in the base: errors of tool, "
            "hand-eye and robot do not repeat there; begin a new batch for this fixture",
        )


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


def with_part(
    batch: Batch | None, at: Float, s: Float, parts: Sequence[tuple[Float, Together]], toolpath: Toolpath
) -> Batch:
    """The batch with one part more: measured values (n,) of shift and tilt at places `s`, for stations `at` (k,)."""
    shared = shared_by(toolpath, () if batch is None else batch.shared.get("part_ids", ()))
    order = np.argsort(s)
    far = ~within(at, s, 2.0 * KEY_POINT_MM)
    new = [np.where(far, np.nan, np.interp(at, s[order], values[order])) for values, _ in parts]
    scatter = [one.scatter for _, one in parts]
    if batch is None:
        return Batch(1, at, new[0], new[1], shared=shared)
    n, before = batch.parts, batch.on(at)
    made = [
        np.where(np.isnan(mean), value, np.where(np.isnan(value), mean, (n * mean + value) / (n + 1)))
        for value, mean in zip(new, (before.shift_mm, before.turn), strict=True)
    ]
    return Batch(n + 1, at, made[0], made[1], scatter[0], scatter[1], shared)
