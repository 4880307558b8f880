"""Which columns of a grid the sensor measures: not those between that it skips, nor those beside its window."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from workbench.artefacts import Check, Recording
from workbench.checks.limits import Bound, check
from workbench.checks.profiles import Chain, chains, sampled
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import is_repeated
from workbench.geometry.grids import widest_blind
from workbench.units import AnyArray, Bool, Float, Int

PINNED = 0.7  # share of the frames whose returns end in one and the same column
PIECES, BEND = 8, np.radians(10.0)  # of a profile, and by how much they differ where its motion shows
MOVED_MM, MOVED_COLUMNS = 0.25, 1.6  # robust standard deviation, by which the end of what is seen would move: ends of
# parts that stay in one column move by up to 0.06 mm, along a ring by 0.08, as a root face doubles by 0.21

BLOCKS, LEAST_ENDS = (32, 16, 8), 20  # columns by which windows move; frames that tell
IN_STEPS, OFTEN = 0.75, 0.05  # share of the frames whose returns end so; and in the third commonest column
# Of gaps within faces: range step across them, at most; how many, at how many places, and what share as narrow as any.
FACE_STEP_MM, LEAST_GAPS, LEAST_PLACES, MOST_GAPS = 1.0, 30, 10, 0.5
STAYS = 0.3  # share of the frames whose end stays in one column, while it might be the window's


def as_delivered(recording: Recording) -> Recording:
    """The recording without the columns in which its sensor measures nothing; itself if there are none.

    A sensor that skips every other column, or whose window is narrower than its grid, may write them as lost returns.
    Taken for these, they tear every face, or pass for the end of one.
    """
    measured = _measured(recording)
    if measured == slice(0, recording.z_mm.shape[1], 1):
        return recording
    x_mm = recording.x_mm[:, measured]
    return dataclasses.replace(
        recording,
        x_mm=x_mm if is_repeated(x_mm) else np.ascontiguousarray(x_mm),
        z_mm=np.ascontiguousarray(recording.z_mm[:, measured]),
        intensity=None if recording.intensity is None else np.ascontiguousarray(recording.intensity[:, measured]),
    )


def end_step_check(column: Int, limits: Mapping[str, Bound] | None = None) -> Check:
    """The check that the columns (n,) in which a face ends are no steps of a window that follows the part."""
    step = _steps_of(column)
    finding = (
        f"the face ends at every {step}th column alone: a window of the sensor that follows the part in steps, and "
        "cuts it? widen it, or hold it still"
    )
    return check("end_step_columns", step, finding if step else "the face ends in any column", given=limits)


def _steps_of(column: Int) -> int:
    """The step of which most columns (n,) are multiples, but for one remainder; 0: of none, or they are two alone."""
    if len(column) < LEAST_ENDS:
        return 0
    for step in BLOCKS:
        remainder = column % step
        value, count = np.unique(column[remainder == np.bincount(remainder).argmax()], return_counts=True)
        shares = np.sort(count) / len(column)
        if len(value) > 2 and shares.sum() > IN_STEPS and shares[-3] > OFTEN:
            return step
    return 0


def hidden_columns(seen: Bool) -> int:
    """How many columns of the part may lie beyond an end that stays in one column, beside others that never return.

    As many as are blind side by side elsewhere, as dirt on the window makes them; 0 where none is, or no end stays.
    seen (n, M): what `returned` of a recording `as_delivered`: nothing has told whether the part or the window ends
    there.
    """
    first, last = _ends(seen)
    if not len(first):
        return 0
    low, high = int(first.min()), int(last.max())
    begins, ends = low > 0, high < seen.shape[1] - 1
    stays = max(begins * (first == low).mean(), ends * (last == high).mean()) > STAYS
    return widest_blind(seen) if stays else 0


def hidden_columns_u(checks: Sequence[Check]) -> float:
    """Standard uncertainty of where a face ends, in columns, by what a recording's checks found (docs/method.md, 3).

    Where its end stays in one column and others are blind elsewhere, it goes on by anything between none and as many
    of them; likewise by the columns that the sensor drops beside lost ones. A moving mean of the sensor moves it by up
    to half its width.
    """
    found = {check.name: check.value or 0.0 for check in checks}
    wide = max(averaged_columns(checks), found.get("mean_frames", 0.0))
    hidden = found.get("hidden_columns", 0.0), found.get("dropped_columns", 0.0), 0.5 * (wide - 1.0)
    return math.hypot(*hidden) / math.sqrt(3.0)


def averaged_columns(checks: Sequence[Check]) -> float:
    """Over how many columns the sensor has averaged, by what a recording's checks found; at least its own column."""
    return max((check.value or 0.0 for check in checks if check.name == "mean_columns"), default=0.0) or 1.0


def dropped_columns(z: AnyArray) -> int:
    """How many columns beside every lost one a sensor drops in rows of ranges (n, M); 0: none.

    Single losses then leave gaps of one width within faces, and no narrower ones.
    """
    seen = np.isfinite(z)
    width, place = [], []
    for row, values in zip(seen, z, strict=True):
        on = np.flatnonzero(row)
        gap = np.diff(on) - 1
        within = (gap > 0) & (np.abs(np.diff(values[on])) < FACE_STEP_MM)
        width.append(gap[within])
        place.append(on[:-1][within])
    gaps, places = np.concatenate(width), np.concatenate(place)
    if len(gaps) < LEAST_GAPS:
        return 0
    least = int(gaps.min())
    single = gaps == least
    spread = len(np.unique(places[single])) >= LEAST_PLACES  # else a few blind columns
    return (least - 1) // 2 if spread and least % 2 == 1 and single.mean() > MOST_GAPS else 0


def some_frames(recording: Recording) -> AnyArray:
    """Ranges (n, M) of some frames of every pass."""
    frames = np.concatenate([sampled(mine) for mine in by_pass(recording.pass_index)])
    return np.asarray(recording.z_mm[frames])


def returned(recording: Recording) -> Bool:
    """What returned (n, M) in some frames of every pass."""
    return np.asarray(np.isfinite(some_frames(recording)))


def _measured(recording: Recording) -> slice:
    z, passes = recording.z_mm, recording.pass_index
    seen = returned(recording)
    step = _step(seen) if _step(seen) == 1 else _step(np.isfinite(z))
    first, last = _ends(seen)
    if not len(first):
        return slice(0, z.shape[1], 1)
    low, high = int(first.min()), int(last.max())
    begins = low > 0 and bool((first == low).mean() > PINNED)
    ends = high < z.shape[1] - 1 and bool((last == high).mean() > PINNED)
    found = chains(recording.x_mm, z, passes) if begins or ends else {}
    begins = begins and any(_moves(chain, recording, 0, low) for chain in found.values())
    ends = ends and any(_moves(chain, recording, 1, high) for chain in found.values())
    return slice(low if begins else low % step, high + 1 if ends else z.shape[1], step)


def _ends(seen: Bool) -> tuple[Int, Int]:
    """First and last column of the frames (N, M) that show something."""
    seen = seen[seen.any(axis=1)]
    return seen.argmax(axis=1), seen.shape[1] - 1 - seen[:, ::-1].argmax(axis=1)


def _step(seen: Bool) -> int:
    """Of columns (M,) between those in which something of the frames (N, M) returned: 1, if neighbours did."""
    ever = np.flatnonzero(seen.any(axis=0))
    return int(np.gcd.reduce(np.diff(ever))) if len(ever) > 2 else 1


def _moves(chain: Chain, recording: Recording, side: int, column: int) -> bool:
    """Whether the first (side 0) or last return moves as the whole profiles do while it stays in one column."""
    seen = np.isfinite(recording.z_mm[chain.frames])
    x = np.where(seen, recording.x_mm[chain.frames].astype(np.float64), np.nan)
    at = np.flatnonzero(_ends(seen)[side] == column)
    middle = chain.frames[len(chain.frames) // 2]
    if not _bends(recording.x_mm[middle].astype(np.float64), recording.z_mm[middle].astype(np.float64)):
        return False
    pitch = float(np.median(np.abs(np.diff(recording.x_mm[middle][np.isfinite(recording.z_mm[middle])]))))
    stretch = chain.track[2]
    for mine in [at[one] for one in by_pass(stretch[at])]:
        end = np.array([x[mine[0], column], recording.z_mm[chain.frames[mine[0]], column]], float)
        gone = chain.carried(end, int(mine[0]))[mine - mine[0], 0]
        if np.ptp(np.percentile(gone, [25.0, 75.0])) / 1.349 > max(MOVED_MM, MOVED_COLUMNS * pitch):
            return True
    return False


def _bends(x: Float, z: Float) -> bool:
    """Whether a profile (M,) has faces of several directions: along a single one nothing shows it move."""
    seen = np.flatnonzero(np.isfinite(x) & np.isfinite(z))
    if seen.size < 2 * PIECES:
        return False
    slopes = [np.polyfit(x[part], z[part], 1)[0] for part in np.array_split(seen, PIECES)]
    return bool(np.ptp(np.arctan(slopes)) > BEND)
