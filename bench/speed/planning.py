"""Planning of a long edge on one core. `python -m bench.speed.planning` prints its times and the peers' as JSON.

It runs in a process of its own, since the number of cores holds for a whole process. Times are the process's own on
that core (what a wall clock shows where nothing else runs), so that other work on the machine does not count.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, TypeVar

from bench.speed.distances import layer_problems, long_raw_edge, open3d_distances, tree_distances
from bench.speed.timing import REPEATS, in_turn, print_on_one_core
from workbench.artefacts import Cloud, Edge, PathGate, Toolpath
from workbench.path import check, feed, layers, simplify
from workbench.path.feed import remaining_stock, stock_distances
from workbench.program import write
from workbench.units import Float

LENGTH_MM, PEER_LENGTH_MM = 5000.0, 250.0
DEPTH_OF_CUT_MM = 0.7  # ten layers in 12 mm of thickness
T = TypeVar("T")


def plan(edge: Edge, cloud: Cloud, laps: dict[str, list[float]]) -> Toolpath:
    """Edge and cloud to a RAPID program; seconds of each stage go into `laps`."""
    start = time.process_time()
    toolpath = _lap(laps, "path.layers", lambda: layers(edge, cloud, depth_of_cut_mm=DEPTH_OF_CUT_MM))
    toolpath = _lap(laps, "path.feed", lambda: feed(toolpath, cloud, edge))
    moves = _lap(laps, "path.simplify", lambda: simplify(toolpath))
    gate = PathGate(True, "timed by itself", toolpath=toolpath, tolerance_mm=0.05)
    _lap(laps, "program.write", lambda: write(moves, gate))
    laps.setdefault("all", []).append(time.process_time() - start)
    _lap(laps, "path.check", lambda: check(toolpath, edge, cloud))
    return toolpath


def _lap(laps: dict[str, list[float]], name: str, stage: Callable[[], T]) -> T:
    start = time.process_time()
    result = stage()
    laps.setdefault(name, []).append(time.process_time() - start)
    return result


def distances(toolpath: Toolpath, cloud: Cloud, edge: Edge) -> list[Float]:
    """d_min of all points of all layers, the index over the cloud included."""
    remaining = remaining_stock(toolpath, cloud, edge)
    return [stock_distances(remaining, toolpath, layer, done) for done, layer in enumerate(toolpath.layers)]


def measure() -> dict[str, Any]:
    """Medians of all times in s, sizes and counts."""
    edge, cloud = long_raw_edge(LENGTH_MM)
    laps: dict[str, list[float]] = {}
    for repeat in range(REPEATS + 1):
        toolpath = plan(edge, cloud, laps if repeat else {})
    short_edge, short_cloud = long_raw_edge(PEER_LENGTH_MM)
    short = layers(short_edge, short_cloud, depth_of_cut_mm=DEPTH_OF_CUT_MM)
    problems = list(layer_problems(short, short_cloud))
    sides: dict[str, Callable[[], Any]] = {
        "ours": lambda: distances(toolpath, cloud, edge),
        "open3d": lambda: [open3d_distances(*problem) for problem in problems],
        "tree": lambda: [tree_distances(*problem) for problem in problems],
    }
    return {
        "stages_s": {name: statistics.median(times) for name, times in laps.items()},
        "distances_s": dict(zip(sides, in_turn(*sides.values(), clock=time.process_time), strict=True)),
        "points": count(toolpath),
        "peer_points": count(short),
        "layers": len(toolpath.layers),
    }


def count(toolpath: Toolpath) -> int:
    """Points of all layers."""
    return sum(len(layer.feed_mm_s) for layer in toolpath.layers)


if __name__ == "__main__":
    print_on_one_core(measure)
