"""One simulated part by three routes: its recording, its cloud written out as PLY, and that cloud shuffled."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bench.drawn.plates import random_recipe
from bench.metrology.part import Clock, Numbers, numbers
from workbench.artefacts import Cloud, Edge, Inspection, PointSet
from workbench.cloud import denoise, read
from workbench.edge import segment, segment_cloud
from workbench.errors import WorkbenchError
from workbench.export import cloud as export_cloud
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import Truth, simulate_recording

ROUTES = ("grid", "ply", "shuffled")


@dataclass(slots=True)
class CloudResult:
    """What each route measured, and by how much it is wrong; one entry a section."""

    condition: str
    seed: int
    refused: str | None = None  # by the gridded route, in one line
    crashed: str | None = None  # any other exception: a defect
    seen_share: float = 1.0
    refused_routes: dict[str, str] = field(default_factory=dict)
    routes: dict[str, dict[str, Numbers]] = field(default_factory=dict)  # route -> see `compare`
    seconds: dict[str, float] = field(default_factory=dict)


def measure_clouds(condition: str, seed: int, _: tuple[str, ...] = ()) -> CloudResult:
    """Simulate part `seed` of a condition and inspect it by every route, told of root and bevel as a drawing does."""
    result = CloudResult(condition, seed)
    clock = Clock(result.seconds)
    recording, truth = simulate_recording(random_recipe(condition, seed))
    nominal = {
        "root_nominal_mm": max(0.5, round(float(truth.root_mm.mean()) * 2) / 2),
        "bevel_nominal_deg": round(float(truth.bevel_deg.mean()) / 5) * 5.0,
    }
    clock.lap("simulation")
    try:
        cloud = fuse(recording)
        result.routes["grid"] = compare(sections(segment(denoise(cloud), **nominal)), truth)
        clock.lap("grid")
        points = written_and_read(cloud)
        clock.lap("file")
        for route in ROUTES[1:]:
            shuffled = np.random.default_rng(seed).permutation(points.points_mm)
            given = points if route == "ply" else replace(points, points_mm=shuffled)
            result.routes |= one_route(result, route, given, nominal, truth)
            clock.lap(route)
    except WorkbenchError as error:
        result.refused = str(error)
    except Exception as error:
        result.crashed = repr(error)
    return result


def written_and_read(cloud: Cloud) -> PointSet:
    """The fused cloud through a PLY file, as `export.cloud` writes it and `cloud.read` reads it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cloud.ply"
        path.write_bytes(export_cloud(cloud).content)
        return replace(read(file=path), source="cloud.ply")


def one_route(
    result: CloudResult, route: str, points: PointSet, nominal: dict[str, float], truth: Truth
) -> dict[str, dict[str, Numbers]]:
    """The route's comparison by its name; nothing, and the reason noted, where it refuses."""
    try:
        edge: Edge = segment_cloud(points, **nominal)[1]
        return {route: compare(sections(edge), truth)}
    except WorkbenchError as error:
        result.refused_routes[route] = str(error)
        return {}


def compare(inspection: Inspection, truth: Truth) -> dict[str, Numbers]:
    """Values, uncertainties and errors of all sections; errors against the truth at each section's own place."""
    found = inspection.sections
    origins = np.array([s.origin_mm for s in found])
    out: dict[str, Numbers] = {}
    for name, unit, true in (("root", "mm", truth.root_mm_at(origins)), ("bevel", "deg", truth.bevel_deg_at(origins))):
        value, u = (np.array([getattr(s, f"{name}{what}_{unit}") for s in found], dtype=float) for what in ("", "_u"))
        out |= {f"{name}_error_{unit}": numbers(value - true), f"{name}_u_{unit}": numbers(u)}
    return out
