"""What is measured: each function makes rows of the table."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench.speed import general, ours
from bench.speed.recordings import unpacked
from bench.speed.timing import REPEATS, Row, alone, in_turn, seconds
from workbench.geometry import grids
from workbench.scan import read

Times = dict[int, tuple[float, float]]  # by million points: recording to inspection, and plainly reading, s
GOALS_S = {(1, "not compressed"): 0.1, (50, "not compressed"): 1.2, (50, "gzip and shuffle"): 1.6}
GENERAL_REPEATS = {1: 5, 10: 3}  # by million points; a size that is not listed is extrapolated


def fusing(million: int) -> Iterator[Row]:
    """`grids.fuse`, in place, beside `np.copyto`: 8 bytes read and 12 written a point, so a copy of 10 a point."""
    frames = million * 1000
    rng = np.random.default_rng(0)
    x, z = (rng.random((frames, 1000), np.float32) for _ in "xz")
    poses = np.repeat(np.eye(4)[None], frames, axis=0)
    out = grids.fuse(x, z, poses, np.zeros(3))
    source = np.ones(x.size * 10 // 4, np.float32)
    target = np.ones_like(source)
    fuse_s, copy_s = in_turn(
        lambda: grids.fuse(x, z, poses, np.zeros(3), out=out), lambda: np.copyto(target, source), repeats=3 * REPEATS
    )
    yield Row(
        f"fuse {million} M points; `np.copyto` of as many bytes",
        seconds(fuse_s),
        seconds(copy_s),
        copy_s / fuse_s,
        "{:.2f} of its speed",
        goal=0.8,
    )


def reading(million: int, packed: Path, times: Times) -> Iterator[Row]:
    """Recording to inspection, and reading alone, beside h5py reading x and z; processor times of all threads."""
    for path, storage in ((unpacked(packed), "not compressed"), (packed, "gzip and shuffle")):
        whole_s, read_s, plain_s = in_turn(
            lambda path=path: ours.read_and_inspect(path),
            lambda path=path: read(recording=path),
            lambda path=path: general.plain_read(path),
            clock=time.process_time,
        )
        times[million] = whole_s, plain_s
        against = f"{million} M points, {storage}; h5py reading x and z"
        yield Row(f"`scan.read` of {against}", seconds(read_s), seconds(plain_s), read_s / plain_s, "{:.2f} x its time")
        yield Row(
            f"recording to inspection, {against}",
            seconds(whole_s),
            seconds(plain_s),
            whole_s,
            "{:.2f} s",
            goal=GOALS_S.get((million, storage)),
            at_most=True,
        )


def routes(paths: dict[int, Path], times: Times, also_largest: bool) -> Iterator[Row]:
    """From memory, and with reading, beside the general route; where that was not run, beside its extrapolation."""
    known: dict[int, float] = {}
    for million, path in paths.items():
        recording = read(recording=path)
        if million in GENERAL_REPEATS or also_largest or len(known) < 2:
            repeats = GENERAL_REPEATS.get(million, 1)
            inspect_s, general_s = in_turn(
                lambda r=recording: ours.inspect(r),
                lambda r=recording: general.planes(r),
                repeats=repeats,
                warm_up=False,
                clock=time.process_time,
            )
            known[million], how = general_s, f"median of {repeats}" if repeats > 1 else "one run"
        else:
            (inspect_s,) = in_turn(lambda r=recording: ours.inspect(r), clock=time.process_time)
            general_s, how = extrapolated(known, million), "extrapolated"
        whole_s, plain_s = times[million]
        other_s = general_s + plain_s
        yield Row(
            f"recording to inspection, {million} M points, gzip; Open3D ({how})",
            seconds(whole_s),
            seconds(other_s),
            other_s / whole_s,
            "{:.0f} x faster",
            goal=300,
        )
        yield Row(
            f"the same from memory, {million} M points; Open3D ({how})",
            seconds(inspect_s),
            seconds(general_s),
            general_s / inspect_s,
            "{:.0f} x faster",
            goal=300,
        )


def extrapolated(known_s: dict[int, float], million: int) -> float:
    """Seconds at `million` points on the straight line through the two largest sizes measured."""
    (a, a_s), (b, b_s) = sorted(known_s.items())[-2:]
    return b_s + (b_s - a_s) / (b - a) * (million - b)


def memory(million: int, path: Path) -> Iterator[Row]:
    """Peak resident memory of a process that reads and inspects; the grid alone is 8 bytes a point."""
    command = [sys.executable, "-m", "bench.speed.ours", str(path)]
    peak = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    yield Row(
        f"peak memory, {million} M points, gzip; x and z alone",
        f"{peak / 1e9:.2f} GB",
        f"{million * 8e-3:.2f} GB",
        peak / 1e9,
        "{:.2f} GB",
        goal=2.5,
        at_most=True,
    )


def linearity(times: Times) -> Iterator[Row]:
    """Time a frame of each size beside that of the smallest but one: constant where the cost is linear."""
    per_frame = {million: whole_s / (million * 1000) for million, (whole_s, _) in times.items()}
    base = sorted(per_frame)[min(1, len(per_frame) - 1)]
    for million, value_s in per_frame.items():
        goal = 1.25 if million > base else None
        yield Row(
            f"time a frame, {million} M points; at {base} M",
            seconds(value_s),
            seconds(per_frame[base]),
            value_s / per_frame[base],
            "{:.2f} x",
            goal,
            at_most=True,
        )


def starting() -> Iterator[Row]:
    """`workbench --help` beside a bare Python that imports argparse, byte code cached on both sides."""

    def run(*command: str) -> None:
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)

    workbench = str(Path(sys.executable).with_name("workbench"))
    help_s, bare_s = in_turn(
        lambda: run(workbench, "--help"), lambda: run(sys.executable, "-c", "import argparse"), repeats=3 * REPEATS
    )
    yield Row(
        '`workbench --help`; `python -c "import argparse"`',
        seconds(help_s),
        seconds(bare_s),
        help_s / bare_s,
        "{:.2f} x its time",
        goal=4,
        at_most=True,
    )


def planning() -> Iterator[Row]:
    """A long edge to its program, and d_min beside Open3D and a k-d tree, in a process on one core."""
    yield from planned(alone("planning"))


def calibrating() -> Iterator[Row]:
    """Nine profiles to the hand-eye pose, beside the paper's genetic algorithm, in a process on one core."""
    yield from calibrated(alone("calibration"))


def calibrated(found: dict[str, Any]) -> Iterator[Row]:
    """Rows of what `bench.speed.calibration` has measured; errors are RMS over the field of view."""
    s, vol = found["seconds"], found["vol_mm"]
    yield Row(
        "hand-eye pose of 9 profiles after circle fits, signs searched, answer checked",
        seconds(s["ours"]),
        "",
        1e3 * s["ours"],
        "{:.2f} ms",
        goal=5,
        at_most=True,
    )
    yield Row(
        "file of 9 profiles to `handeye.json`, libraries imported",
        seconds(found["file_s"]),
        "",
        found["file_s"],
        "{:.3f} s",
        goal=1,
        at_most=True,
    )
    others = (("DE", "scipy's differential evolution"), ("GA", "the paper's GA, vectorised"))
    for name, other in others:
        yield Row(
            "hand-eye pose of 9 profiles, signs searched, "
            f"error {vol['ours']:.3f} mm; {other}, error {vol[name]:.3f} mm",
            seconds(s["ours"]),
            seconds(s[name]),
            s[name] / s["ours"],
            "{:.0f} x faster",
            goal=300,
        )


def planned(found: dict[str, Any]) -> Iterator[Row]:
    """Rows of what `bench.speed.planning` has measured. The peers' times are linear in the points of the path."""
    stages_s, points = found["stages_s"], found["points"]
    parts = ", ".join(f"{name} {seconds(stages_s[name])}" for name in stages_s if name not in ("all", "path.check"))
    yield Row(
        f"5 m raw edge to RAPID, {found['layers']} layers, {points:,} points, one core ({parts})",
        seconds(stages_s["all"]),
        "",
        stages_s["all"],
        "{:.2f} s",
        goal=2,
        at_most=True,
    )
    yield Row("`path.check` of it", seconds(stages_s["path.check"]), "", stages_s["path.check"], "{:.2f} s")
    ours_s, scale = found["distances_s"]["ours"], points / found["peer_points"]
    for name, words in (("open3d", "Open3D `compute_point_cloud_distance`"), ("tree", "scipy `cKDTree`")):
        other_s = found["distances_s"][name] * scale
        yield Row(
            f"d_min of all {points:,} points, one core; {words} (extrapolated from {found['peer_points']:,})",
            seconds(ours_s),
            seconds(other_s),
            other_s / ours_s,
            "{:.0f} x faster",
            goal=50,
        )
