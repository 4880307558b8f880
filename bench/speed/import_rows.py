"""Rows of the table about `workbench import`: 50 million points of a table, a row a point, and a table of poses.

`python -m bench.speed.import_rows FOLDER` imports scan.csv and robot.csv there and prints its peak memory.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.csv

from bench.speed.ours import peak_bytes
from bench.speed.recordings import simulated
from bench.speed.timing import Row

MILLION, GOAL_S, GOAL_GB = 50, 8, 1
BLOCK = 1000  # frames that are written at once


def importing(recordings: Path) -> Iterator[Row]:
    """Processor seconds and peak memory of the command, run once; the recording is kept in `recordings`."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        frames = _write_tables(simulated(MILLION, recordings), folder)
        command = [sys.executable, "-m", "bench.speed.import_rows", name]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        size = (folder / "scan.csv").stat().st_size / 1e9
    spent, peak = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, int(told.split()[-1]) / 1e9
    what = f"import of {frames:,} profiles, a CSV of {MILLION} M points and {size:.1f} GB (one run)"
    yield Row(f"{what}, processor time", f"{spent:.2f} s", "", spent, "{:.1f} s", goal=GOAL_S, at_most=True)
    yield Row(f"{what}, peak memory", f"{peak:.2f} GB", "", peak, "{:.2f} GB", goal=GOAL_GB, at_most=True)


def _write_tables(path: Path, folder: Path) -> int:
    with h5py.File(path) as file, (folder / "scan.csv").open("wb") as table:
        profiles, robot = file["profiles"], file["robot"]
        frames, columns = profiles["x"].shape
        table.write(b"frame,time_s,x_mm,z_mm\n")
        for first in range(0, frames, BLOCK):
            some = slice(first, min(first + BLOCK, frames))
            number, time = np.arange(some.start, some.stop), np.round(profiles["time"][some], 6)
            rows = {"frame": number.repeat(columns), "time_s": time.repeat(columns)}
            rows |= {f"{axis}_mm": np.round(profiles[axis][some].ravel().astype(float), 4) for axis in "xz"}
            known = np.isfinite(rows["z_mm"])
            block = pa.table({key: values[known] for key, values in rows.items()})
            pyarrow.csv.write_csv(block, table, pyarrow.csv.WriteOptions(include_header=False))
        poses = np.column_stack([robot[key][()] for key in ("time", "position", "quaternion_wxyz")])
        hand_eye = file["hand_eye/flange_from_profiler"][()].tolist()
    head = "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz"
    np.savetxt(folder / "robot.csv", poses, "%.9f", ",", header=head, comments="")
    mapping = {"format": "import-mapping", "version": 1, "hand_eye": {"flange_from_profiler": hand_eye}}
    (folder / "map.json").write_text(json.dumps(mapping))
    return int(frames)


def _import(folder: Path) -> int:
    from workbench.cli import main

    sources = [str(folder / name) for name in ("scan.csv", "robot.csv")]
    return main(["import", *sources, "--mapping", str(folder / "map.json"), "--out", str(folder / "part.h5")])


if __name__ == "__main__":
    failed = _import(Path(sys.argv[1]))
    print(peak_bytes())
    sys.exit(failed)
