"""Mutations of what a recording says: they pass its reader often enough to reach planning and inspection."""

from __future__ import annotations

import io
import random
from collections.abc import Callable
from typing import Any

import numpy as np

Values = dict[str, Any]  # arrays by their place in the file
GRIDS = ("profiles/x", "profiles/z")
FRAMES = ("profiles/time", "profiles/pass", *GRIDS, "profiles/intensity")
POSES = ("robot/time", "robot/position", "robot/quaternion_wxyz", "robot/pass")


def mutated_recording(content: bytes, _: str, rng: random.Random) -> bytes:
    """A recording changed in one to four places: its grids, its poses, its frames, its calibration."""
    import h5py

    made = io.BytesIO(content)
    with h5py.File(made, "r+") as file:
        names: list[str] = []
        file.visititems(lambda name, found: names.append(name) if isinstance(found, h5py.Dataset) else None)
        values = {name: file[name][()] for name in names}
        for _ in range(rng.randint(1, 4)):
            rng.choice(CHANGES)(values, rng, np.random.default_rng(rng.getrandbits(32)))
        for name in names:
            del file[name]
            file[name] = values[name]
    return made.getvalue()


def _block(shape: tuple[int, ...], rng: random.Random) -> tuple[slice, ...]:
    """A part of an array, now and then all of it."""
    return tuple(slice(None) if rng.random() < 0.4 else _span(size, rng) for size in shape)


def _span(size: int, rng: random.Random) -> slice:
    first = rng.randrange(size)
    return slice(first, rng.randint(first + 1, size))


def _part(values: Values, rng: random.Random) -> Any:
    """A block of one of both grids, to be changed in place."""
    grid = values[rng.choice(GRIDS)]
    return grid[_block(grid.shape, rng)]


def _length(rng: random.Random) -> float:
    return rng.choice((-1, 1)) * 10 ** rng.uniform(-5, 3)


def _lose(values: Values, rng: random.Random, draws: np.random.Generator) -> None:
    """Returns go missing: a block, or some anywhere."""
    part = _part(values, rng)
    part[draws.random(part.shape) < rng.choice((0.02, 0.3, 0.9, 1.0))] = np.nan


def _shift(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    part = _part(values, rng)
    part += np.float32(_length(rng))


def _scale(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    part = _part(values, rng)
    part *= np.float32(rng.choice((0.0, -1.0, 0.5, 1.01, 25.4, 1e-3, 1e3)))


def _noise(values: Values, rng: random.Random, draws: np.random.Generator) -> None:
    part = _part(values, rng)
    part += draws.normal(0.0, abs(_length(rng)), part.shape).astype(np.float32)


def _round(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    grid, step = values[rng.choice(GRIDS)], np.float32(abs(_length(rng)))
    part = grid[_block(grid.shape, rng)]
    part[:] = np.round(part / step) * step


def _constant(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    part = _part(values, rng)
    part[:] = part.flat[0]


def _turn_round(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    """Rows or columns in another order, or every so many of them alone."""
    names = rng.choice((GRIDS, FRAMES, POSES, (rng.choice(GRIDS),)))
    kind = rng.choice(("reversed", "shuffled", "repeated"))
    order = None
    for name in names:
        if name in values:
            size = len(values[name])
            if order is None:
                order = list(range(size))
                if kind == "reversed":
                    order.reverse()
                elif kind == "shuffled":
                    rng.shuffle(order)
                else:
                    order = [i - i % rng.choice((2, 3, 10)) for i in order]
            values[name] = values[name][order]


def _thin(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    """Fewer frames, or fewer columns."""
    present = [name for name in FRAMES if name in values]
    if rng.random() < 0.5:
        frames = range(len(values["profiles/time"]))
        keep = sorted(rng.sample(frames, min(len(frames), rng.choice((1, 2, 3, 5, 12)))))
        for name in present:
            values[name] = values[name][keep]
    else:
        span = _span(values["profiles/x"].shape[1], rng)
        for name in present:
            if values[name].ndim > 1:
                values[name] = values[name][:, span]


def _passes(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    """Passes that were one, or are several."""
    time = np.asarray(values["profiles/time"])
    cuts = sorted(rng.uniform(float(time[0]), float(time[-1])) for _ in range(rng.randint(0, 3)))
    values["profiles/pass"] = np.searchsorted(cuts, time).astype(np.int32)
    values["robot/pass"] = np.searchsorted(cuts, values["robot/time"]).astype(np.int32)


def _pose(values: Values, rng: random.Random, draws: np.random.Generator) -> None:
    position = values["robot/position"]
    part = position[_block(position.shape, rng)]
    change = rng.choice(("still", "shift", "noise", "scale"))
    if change == "still":
        part[:] = part[:1]
    elif change == "shift":
        part += _length(rng)
    elif change == "noise":
        part += draws.normal(0.0, abs(_length(rng)), part.shape)
    else:
        part *= rng.choice((0.0, -1.0, 1e-3, 1e3, 1.01))


def _orientation(values: Values, rng: random.Random, draws: np.random.Generator) -> None:
    turn = values["robot/quaternion_wxyz"]
    part = turn[_block(turn.shape[:1], rng)]
    if rng.random() < 0.5:
        part[:] = part[:, rng.sample(range(4), 4)]
    else:
        part += draws.normal(0.0, rng.choice((1e-4, 1e-2, 1.0)), part.shape)
        part /= np.maximum(np.linalg.norm(part, axis=1, keepdims=True), 1e-9)


def _hand_eye(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    pose = values["hand_eye/flange_from_profiler"]
    if rng.random() < 0.5:
        pose[:3, 3] += [_length(rng) for _ in range(3)]
    else:
        pose[:3, :3] = pose[:3, rng.sample(range(3), 3)]


def _time(values: Values, rng: random.Random, _: np.random.Generator) -> None:
    values[rng.choice(("profiles/time", "robot/time"))] *= rng.choice((1.0001, 0.5, 1e-3, 1e3))


CHANGES: tuple[Callable[[Values, random.Random, np.random.Generator], None], ...] = (
    _lose,
    _shift,
    _scale,
    _noise,
    _round,
    _constant,
    _turn_round,
    _thin,
    _passes,
    _pose,
    _orientation,
    _hand_eye,
    _time,
)
