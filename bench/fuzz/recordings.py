"""Mutations of what a recording says: many pass its reader and reach planning and inspection."""

from __future__ import annotations

import io
import random
from collections.abc import Callable
from typing import Any

import numpy as np

GRIDS = ("profiles/x", "profiles/z", "profiles/intensity")
FRAMES = ("profiles/time", "profiles/pass", *GRIDS)
POSES = ("robot/time", "robot/position", "robot/quaternion_wxyz", "robot/pass")
HAND_EYE = "hand_eye/flange_from_profiler"
TOGETHER = (  # arrays whose rows, or columns, belong to each other, and that axis
    *((FRAMES, 0), (POSES, 0), (GRIDS, 1)),
    *((("profiles/z",), 0), ((POSES[2],), 1), ((HAND_EYE,), 1)),
)
FORMS: tuple[Callable[[Any], Any], ...] = (
    lambda array: array[..., None],
    lambda array: array[:0],
    lambda array: array.astype("S8"),
    lambda array: array.astype(complex),
    lambda array: np.nan_to_num(array).astype(np.int64),
    lambda _: 3.0,
)
SAID = ("format", "version", "length_unit", "time_unit", "clock", "part_id")
WORDS: tuple[Any, ...] = ("m", "", 2, -1, 1.5, np.array([1, 2]), b"\xff", "own")
Change = Callable[[Any, random.Random, np.random.Generator], None]  # of an open file, in place


def mutated_recording(content: bytes, _: str, rng: random.Random) -> bytes:
    """A recording changed in one to four places: its numbers, their order, its passes, its orientations."""
    return _changed(content, rng, [rng.choice(CHANGES) for _ in range(rng.randint(1, 4))])


def malformed_recording(content: bytes, _: str, rng: random.Random) -> bytes:
    """A recording with an array of another form or none, or with another attribute."""
    return _changed(content, rng, [_form])


def _changed(content: bytes, rng: random.Random, changes: list[Change]) -> bytes:
    import h5py

    made = io.BytesIO(content)
    with h5py.File(made, "r+") as file, np.errstate(all="ignore"):
        for change in changes:
            change(file, rng, np.random.default_rng(rng.getrandbits(32)))
    return made.getvalue()


def _put(file: Any, name: str, values: Any) -> None:
    del file[name]
    file[name] = values


def _length(rng: random.Random) -> float:
    return rng.choice((-1, 1)) * 10 ** rng.uniform(-5, 3)


def _span(size: int, rng: random.Random) -> slice:
    """A part of an axis, now and then all of it."""
    first = 0 if rng.random() < 0.4 else rng.randrange(size)
    return slice(first, size if rng.random() < 0.4 else rng.randint(first + 1, size))


def _numbers(file: Any, rng: random.Random, draws: np.random.Generator) -> None:
    """A block of an array: numbers go missing or are extreme, shifted, scaled, noisy, rounded, all alike."""
    name = rng.choice([name for name in (*FRAMES, *POSES, HAND_EYE) if name in file])
    values = file[name][()]
    block = tuple(_span(size, rng) for size in values.shape)
    part, step = values[block].astype(float), _length(rng)
    lost = draws.random(part.shape) < rng.choice((0.02, 0.3, 0.9, 1.0))
    values[block] = rng.choice(
        (
            np.where(lost, rng.choice((np.nan, np.nan, np.inf, -3e38, 0.0, 1e9)), part),
            part + step,
            part * rng.choice((0.0, -1.0, 0.5, 1.0001, 1.01, 25.4, 1e-3, 1e3)),
            part + draws.normal(0.0, abs(step), part.shape),
            np.round(part / step) * step,
            np.broadcast_to(part[:1], part.shape),
        )
    )
    file[name][...] = values


def _order(file: Any, rng: random.Random, draws: np.random.Generator) -> None:
    """Frames, poses or columns in another order, some of them several times, or only some of them."""
    names, axis = rng.choice(TOGETHER)
    size = min(file[name].shape[axis] for name in names if name in file)  # one may have been cut already
    every = np.arange(size)
    some = np.sort(draws.choice(every, min(size, rng.choice((1, 2, 3, 5, 12))), replace=False))
    repeated = every - every % rng.choice((2, 3, 10))
    order = rng.choice((every[::-1], draws.permutation(size), repeated, some, every[_span(size, rng)]))
    for name in names:
        if name in file:
            _put(file, name, np.take(file[name][()], order, axis))


def _passes(file: Any, rng: random.Random, _: np.random.Generator) -> None:
    """Passes that were one, or are several."""
    first, last = file["profiles/time"][()][[0, -1]]
    cuts = sorted(rng.uniform(float(first), float(last)) for _ in range(rng.randint(0, 3)))
    for group in ("profiles", "robot"):
        if f"{group}/pass" in file:
            _put(file, f"{group}/pass", np.searchsorted(cuts, file[f"{group}/time"][()]).astype(np.int32))


def _orientation(file: Any, rng: random.Random, draws: np.random.Generator) -> None:
    """Orientations off at random that are orientations still."""
    turn = file[POSES[2]][()]
    turn += draws.normal(0.0, rng.choice((1e-4, 1e-2, 1.0)), turn.shape)
    _put(file, POSES[2], turn / np.linalg.norm(turn, axis=1, keepdims=True))


def _form(file: Any, rng: random.Random, _: np.random.Generator) -> None:
    name = rng.choice([name for name in (*FRAMES, *POSES, HAND_EYE, "profiles", "robot", "hand_eye") if name in file])
    action = rng.random()
    if action < 0.3:
        file[rng.choice(("/", "profiles"))].attrs[rng.choice(SAID)] = rng.choice(WORDS)
    elif action < 0.5 or "/" not in name:
        del file[name]
    else:
        _put(file, name, rng.choice(FORMS)(file[name][()]))


CHANGES: tuple[Change, ...] = (_numbers, _numbers, _numbers, _order, _order, _passes, _orientation)
