"""Fusing against a plain copy of as many bytes, and reading a recording against h5py and numpy alone.

Each function returns rows (name, our seconds, the other's seconds, ratio): ratio is the other's time over ours, so 1 is
as fast and 0.8 is at 0.8 of its speed. Medians of `REPEATS`, both sides in turn.

`python bench/fuse.py [million points...]`, 1 and 10 unless told.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from workbench.artefacts import Recording
from workbench.geometry import grids
from workbench.scan import read
from workbench.scan.write import write

COLUMNS = 1000
REPEATS = 5
Row = tuple[str, float, float, float]


def fusing(million_points: int) -> Row:
    """`grids.fuse`, in place, against `np.copyto`: 8 bytes read and 12 written a point, so a copy of 10 a point."""
    x, z = grid(million_points)
    poses = np.repeat(np.eye(4)[None], len(x), axis=0)
    poses[:, 1, 3] = np.arange(len(x)) * 0.1
    out = np.empty((*x.shape, 3), np.float32)
    source = np.ones(x.size * 10 // 4, np.float32)
    target = np.ones_like(source)
    return versus(
        f"fuse, {million_points} M points, against np.copyto",
        lambda: grids.fuse(x, z, poses, np.zeros(3), out=out),
        lambda: np.copyto(target, source),
    )


def reading(million_points: int) -> list[Row]:
    """`scan.read` (every check and the SHA-256 included) against h5py and np.fromfile reading x and z, warm cache."""
    storages: dict[str, dict[str, Any]] = {
        "contiguous": {},
        "chunked": {"chunks": (64, COLUMNS)},
        "gzip and shuffle": {"chunks": (64, COLUMNS), "compression": "gzip", "shuffle": True},
        "lzf": {"chunks": (64, COLUMNS), "compression": "lzf"},
    }
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.h5"
        write(recording(*grid(million_points)), path)
        megabytes = million_points * 8
        for name, storage in storages.items():
            if storage:
                store(path, storage)
            rows.append(
                versus(
                    f"read {megabytes} MB, {name}, against h5py", lambda: read(recording=path), lambda: plain_h5py(path)
                )
            )
            if not storage:
                rows.append(
                    versus(
                        f"read {megabytes} MB, {name}, against np.fromfile",
                        lambda: read(recording=path),
                        lambda: plain_numpy(path),
                    )
                )
    return rows


def grid(million_points: int) -> tuple[Any, Any]:
    """x and z (mm) of a face with noise, resolved to 0.25 micrometres as sensors do, 2 % of it missing."""
    rng = np.random.default_rng(0)
    frames = million_points * 1_000_000 // COLUMNS
    x = np.broadcast_to(np.linspace(-25, 25, COLUMNS, dtype=np.float32), (frames, COLUMNS)).copy()
    z = rng.standard_normal((frames, COLUMNS), np.float32)
    z *= 0.012
    z += 200
    z *= 4000
    np.rint(z, out=z)
    z /= 4000
    z[rng.random(frames) < 0.02] = np.nan
    return x, z


def recording(x: Any, z: Any) -> Recording:
    """A straight motion with poses at its two ends."""
    frames = len(x)
    return Recording(
        source="bench",
        time_s=np.arange(frames) * 0.02,
        x_mm=x,
        z_mm=z,
        pass_index=np.zeros(frames, np.int64),
        robot_time_s=np.array([0.0, frames * 0.02]),
        robot_position_mm=np.array([[0.0, 0, 0], [frames * 0.1, 0, 0]]),
        robot_quaternion_wxyz=np.array([[1.0, 0, 0, 0], [1.0, 0, 0, 0]]),
        robot_pass=np.zeros(2, np.int64),
        flange_from_profiler=np.eye(4),
    )


def store(path: Path, storage: dict[str, Any]) -> None:
    """Store the file's grid anew, in another file so that no space is lost."""
    with h5py.File(path) as old, h5py.File(path.with_suffix(".new"), "w") as new:
        new.attrs.update(old.attrs)
        old.copy("robot", new)
        old.copy("hand_eye", new)
        for name, values in old["profiles"].items():
            new.create_dataset(f"profiles/{name}", data=values[()], **(storage if name in "xz" else {}))
    path.with_suffix(".new").replace(path)


def plain_h5py(path: Path) -> tuple[Any, Any]:
    with h5py.File(path) as file:
        return file["profiles/x"][()], file["profiles/z"][()]


def plain_numpy(path: Path) -> tuple[Any, ...]:
    with h5py.File(path) as file:
        sets = [file["profiles/x"], file["profiles/z"]]
        places = [(each.size, each.id.get_offset()) for each in sets]
    return tuple(np.fromfile(path, np.float32, size, offset=offset) for size, offset in places)


def versus(name: str, ours: Callable[[], Any], other: Callable[[], Any]) -> Row:
    """Medians of both, in turn, after one run each that is not counted."""
    times: tuple[list[float], list[float]] = ([], [])
    for repeat in range(REPEATS + 1):
        for action, taken in zip((ours, other), times, strict=True):
            start = time.perf_counter()
            action()
            if repeat:
                taken.append(time.perf_counter() - start)
    ours_s, other_s = (statistics.median(taken) for taken in times)
    return name, ours_s, other_s, other_s / ours_s


def main() -> None:
    sizes = [int(argument) for argument in sys.argv[1:]] or [1, 10]
    for size in sizes:
        for name, ours_s, other_s, ratio in [fusing(size), *reading(size)]:
            print(f"{name:55} {ours_s * 1e3:9.2f} ms {other_s * 1e3:9.2f} ms {ratio:6.2f}")


if __name__ == "__main__":
    main()
