"""The page that a run writes: what was measured, on what machine, and how to measure it again."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from pathlib import Path

from bench.speed.timing import REPEATS, Row
from workbench.geometry.blocks import cores
from workbench.pipeline.run import versions

HEAD = """<!-- Written by `make bench`: measure again rather than edit. -->

# Benchmarks

Both sides of a line were run in turn, in one run of `{command}`; medians of {repeats} at least unless the line says
otherwise. The recordings come from the project's own simulator (`bench/speed/recordings.py`): a milled edge, a frame
every 0.1 mm, 1,000 columns, 0.5 % outliers, every frame simulated by itself; 50 million points are 5 m of edge. Files
are read from a warm cache.

Machine: {machine}. {packages}.

| what; beside what | workbench | the other | factor | goal | |
|---|---|---|---|---|---|
"""

FOOT = """
The Open3D route (`bench/speed/general.py`) is what one would write without this project: points into the base with
numpy, float64, `remove_statistical_outlier(nb_neighbors=20, std_ratio=2)`, `segment_plane` twice (0.1 mm, 1,000 trials)
on the whole cloud. It ends with two planes; no section, root face or uncertainty. "Extrapolated": not run, but taken
from the straight line through the two largest sizes that were run; `python -m bench.speed --all` runs it there too.

The picture (`bench/speed/pictures.py`): the fused cloud in the order of the scan, in one parallel projection, drawn on
the processor by both. Ours (`workbench/geometry/splat.py`) draws four times as many pixels, averages them and lights
them by depth; VTK draws squares of 2 pixels without light.

Planning: a raw edge and a cloud made by formula (`bench/speed/raw_edges.py`), 5 m long, 12 mm thick, an arc of 10 m, 50
million points, ten layers of 0.7 mm; from edge and cloud to the program by `path.layers`, `path.feed`, `path.simplify`,
`program.write`. d_min is the distance from the cutter's axis to all that still stands, for every point of every layer,
the index over the cloud included. The others sample the axis every mm and ask for the nearest point of what is left of
the cloud (`bench/speed/distances.py`), the tree built anew for each layer, on 250 mm of the same edge; their time for
5 m is taken as linear in the number of points.

Calibration (`bench/speed/calibration.py`): ten sets of nine postures of a simulated 10 mm sphere, the same circles for
both sides. The genetic algorithms minimise the paper's equations (6) and (8), put right, in two steps within 20 deg and
50 mm about the design's pose, 100 x 100 evaluations a step, with the signs of h, which they do not find, given. scipy's
is the maintained library's, an individual at a time; the vectorised one evaluates a generation in one call of numpy.

Postures (`bench/speed/postures.py`): the shipped path of a raw arc and the shipped cell; the cluttered one has 40 boxes
of 300 mm around the robot. The optimum is searched on the grid of 1 deg x 1 deg, from nothing: traversal, bodies for
collision, best-first search, all 1,016 points of the chosen cell against all pairs of bodies. The loops
(`bench/peers/clik.py`) solve one pose at a time and form J K^-1 J^T f with pinocchio's Jacobian; each of EAIK's
branches counts as a posture; CLIK starts from one posture in the middle of the joints' ranges. The law of both angles
is sought among all nodes of the grid at all points, with collision and the limits of speed and acceleration.

Planning, calibration and postures: processor times on one core, in which other work on the machine does not count.

Batches (`bench/speed/batch_rows.py`): small parts, each simulated by itself (121 frames of 300 columns), inspected
without a report. Wall clock, once the workers are warm; overhead is what a part takes in a batch less what its stages
take. The dask worker is killed with SIGKILL after a quarter of the parts; all results are compared with those of one
machine.

Start-up (`bench/speed/start_rows.py`): processor seconds of the command and its children, for the shipped milled edge
(309 frames of 600 columns) and the shipped closed loop. Set-up compiles the kernels, a wheel of `make wheel` brings
them; "without set-up" begins with an empty folder for them, as after `pip install` of a wheel without kernels. Bytecode
is kept, as pip does. `--follow` (`bench/speed/follow_rows.py`): a writer in SWMR mode sends a recording in twenty parts
over eight seconds and closes it. The installation: clone, packages into an empty cache, kernels, `make demo`.
"""


def line(row: Row) -> str:
    """One row in Markdown."""
    goal = "" if row.goal is None else f"{'at most' if row.at_most else 'at least'} {row.goal:g}"
    verdict = {None: "", True: "yes", False: "**no**"}[row.met]
    return f"| {row.what} | {row.ours} | {row.other} | {row.factor_is.format(row.factor)} | {goal} | {verdict} |"


def document(found: Iterable[Row], arguments: list[str]) -> str:
    """The whole page."""
    command = " ".join(["make bench"] if not arguments else ["python -m bench.speed", *arguments])
    known = versions()
    packages = ", ".join(f"{name} {known[name]}" for name in ("numpy", "numba", "h5py", "open3d"))
    head = HEAD.format(command=command, repeats=REPEATS, machine=machine(), packages=packages)
    return head + "".join(f"{line(row)}\n" for row in found) + FOOT


def machine() -> str:
    """Processor, cores, memory and load, in words."""
    words = [f"{cores()} cores of {_processor()}"]
    if hasattr(os, "sysconf"):
        memory_gb = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
        words.append(f"{memory_gb:.0f} GB of memory")
    if hasattr(os, "getloadavg"):
        words.append(f"load average {os.getloadavg()[2]:.1f} over the last quarter of an hour")
    return ", ".join([*words, f"{platform.system()}, Python {platform.python_version()}"])


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.exists() else ""
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.machine()
