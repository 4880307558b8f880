"""Of a sensor and a robot that hardly err, edge, axes, sizes and labels are the part's own, from every view."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud, Edge
from workbench.cloud import denoise
from workbench.edge import segment, segment_raw
from workbench.scan import fuse
from workbench.synthetic import Truth, parse_recipe, simulate_recording
from workbench.units import DEG, Float

PART = {
    "length_mm": 50.0,
    "root_mm": {"start": 1.4, "end": 1.7},
    "bevel_deg": {"start": 39.0, "end": 41.0},
    "base_from_part": {"position_mm": [1300, -700, 900], "rpy_deg": [130, 40, -70]},
}
SCANNER = {"columns": 300, "pitch_mm": 0.08, "noise": {"sd_mm": 0.001}}
ARC, EDGE = {"shape": "arc", "radius_mm": 300}, {"motion": "stream", "follow": "edge"}
VIEWS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {  # part, scan, scanner
    "from above": ({}, {}, {}),
    "oblique": ({}, {"oblique_deg": 12, "lead_deg": -8}, {}),
    "square to the root face": ({}, {"elevation_deg": 5.0}, {}),
    "from below": ({}, {"elevation_deg": -25.0}, {}),
    "oblique from below": ({}, {"elevation_deg": -25.0, "oblique_deg": -12}, {}),
    "back, by other axes": (
        {},
        {"from_mm": 47.0, "to_mm": 3.0},
        {"x_rises": False, "z_away": False, "zero_range_mm": 170, "x_offset_mm": 7},
    ),
    "convex": ({"curve": ARC}, EDGE, {"x_rises": False}),
    "concave, oblique": ({"curve": ARC | {"sense": "concave"}}, EDGE | {"oblique_deg": 10}, {"sampling": "angular"}),
    "wavy": (
        {"curve": {"shape": "wavy", "wavelength_mm": 120}},
        {"motion": "stream"},
        {"z_away": False, "zero_range_mm": 170},
    ),
    "without noise": ({}, {}, {"noise": {"sd_mm": 0.0}}),
    "shaken": ({}, {}, {}),
}


class Seen(NamedTuple):
    cloud: Cloud
    edge: Any
    truth: Truth
    back: bool

    def true(self, name: str) -> Float:
        """The truth's vectors at the stations that are seen."""
        at = self.truth.arc_length_mm_at(self.edge.position_mm[self.edge.seen])
        return np.stack([np.interp(at, self.truth.arc_length_mm, one) for one in getattr(self.truth, name).T], axis=1)

    def points(self) -> tuple[Any, Float, Float, Float]:
        """Label of each point, its place in the base, and how far out of the end face and how far up it lies."""
        i, j = np.nonzero(self.cloud.keep)
        x, z = (of[i, j].astype(float)[:, None] for of in (self.cloud.x_mm, self.cloud.z_mm))
        pose = self.cloud.base_from_profiler[i]
        at = pose[:, :3, 3] + x * pose[:, :3, 0] + z * pose[:, :3, 2]
        s = self.truth.arc_length_mm_at(at)
        foot, out, up = (
            np.stack([np.interp(s, self.truth.arc_length_mm, one) for one in getattr(self.truth, name).T], axis=1)
            for name in ("position_mm", "normal", "across")
        )
        return self.edge.labels[i, j], at, ((at - foot) * out).sum(axis=1), ((at - foot) * up).sum(axis=1)


@cache
def seen(view: str, kind: str = "milled") -> Seen:
    part, scan, scanner = VIEWS[view]
    robot = {"frame_pitch_mm": 0.6, "pose_rate_hz": 250, "frame_rate_hz": 50}
    recipe = {
        "seed": 4,
        "part": PART | {"kind": kind} | part,
        "passes": [{"from_mm": 3.0, "to_mm": 47.0, "skew_mm": [-0.6, 0.9]} | scan],
        "scanner": SCANNER | scanner,
        "robot": robot | ({"vibration_mm": 0.05} if view == "shaken" else {}),
    }
    recording, truth = simulate_recording(parse_recipe(recipe))
    cloud = denoise(fuse(recording))
    if kind == "raw":
        up = truth.across[0] - 0.36 * truth.normal[0]
        errs = 0.05 if view == "shaken" else 1e-4
        edge: Edge = segment_raw(cloud, upper_side=tuple(up), robot_noise_mm=errs)
    else:
        edge = segment(cloud, edge_condition="sharp")
    return Seen(cloud, edge, truth, "back" in view)


def most_deg(one: Float, other: Float) -> float:
    return float(np.degrees(np.linalg.norm(np.cross(one, other), axis=1).max()))


def assert_lies_along_the_part(found: Seen, most_mm: float, most_turn_deg: float) -> None:
    edge: Edge = found.edge
    assert edge.seen.all()
    assert np.linalg.norm(edge.position_mm - found.true("position_mm"), axis=1).max() < most_mm
    for name in ("tangent", "normal", "across"):
        assert most_deg(getattr(edge, name), found.true(name)) < most_turn_deg, name
        assert (getattr(edge, name) * found.true(name)).sum(axis=1).min() > 0.9, name
    np.testing.assert_allclose(np.cross(edge.across, edge.normal), edge.tangent, atol=1e-9)
    s = found.truth.arc_length_mm_at(edge.position_mm)
    np.testing.assert_allclose(s - s[0], edge.arc_length_mm, atol=0.01)
    frames = np.interp(edge.frame_arc_length_mm, edge.arc_length_mm, s)
    assert np.nanmedian(np.abs(np.diff(frames))) == pytest.approx(0.6, rel=0.25)
    assert (frames[~np.isnan(frames)][-1] > 25.0) is not found.back  # along the edge, not the robot's way


@pytest.mark.parametrize("view", VIEWS)
def test_a_milled_edge_lies_where_it_was_built(view: str) -> None:
    turn_deg = {"wavy": 0.1, "concave, oblique": 0.05, "shaken": 0.2}.get(view, 0.02)
    assert_lies_along_the_part(seen(view), 0.1 if view == "shaken" else 0.02, turn_deg)


@pytest.mark.parametrize("view", VIEWS)
def test_root_face_and_bevel_angle_are_those_of_the_recipe(view: str) -> None:
    """To a tenth of a column where it ends in a column, to micrometres where its corner is seen."""
    found = seen(view)
    root = found.edge.root.value - found.truth.root_mm_at(found.edge.position_mm)
    bevel = found.edge.bevel.value - found.truth.bevel_deg_at(found.edge.position_mm)
    assert np.abs(root).max() < (0.002 if "below" in view else 0.01)
    assert np.abs(bevel).max() < 0.015
    assert np.abs(root / found.edge.root.u).max() < 3.0
    assert np.abs(bevel / found.edge.bevel.u).max() < 3.0


RAW = ["oblique", "back, by other axes", "concave, oblique", "wavy", "shaken"]


STEADY = [(view, kind) for kind, views in (("milled", VIEWS), ("raw", RAW)) for view in views if view != "shaken"]


@pytest.mark.parametrize(("view", "kind"), STEADY)
def test_points_bear_the_name_of_their_face(view: str, kind: str) -> None:
    """All of them, but for the points next to a corner, which a face that may be rough takes with it."""
    found, named = seen(view, kind), 1.0 if kind == "milled" else 0.97
    label, at, out, up = found.points()
    lean, root = found.truth.bevel_deg_at(at) * DEG, found.truth.root_mm_at(at)
    if kind == "raw":
        lean, root = 0.0 * out, 0.0 * out + 8.0
    over = out * np.cos(lean) + (up - root) * np.sin(lean)
    on = {
        ROOT_FACE: (out, (up > 0.15) & (up < root - 0.15)),
        BEVEL_FACE: (over, (up > root + 0.15) & (up < 7.85)),
        UPPER_SURFACE: (up - 8.0, over < -0.15),
        LOWER_SURFACE: (up, out < -0.15),
    }
    for face, (off, inside) in on.items():
        its = inside & (np.abs(off) < 0.006)
        assert np.quantile(np.abs(np.append(off[label == face], 0.0)), named) < 0.006, face
        assert its.sum() < 500 or (label[its] == face).mean() > 0.95, face
    assert {*np.unique(label)} >= ({ROOT_FACE, UPPER_SURFACE} if kind == "raw" else {ROOT_FACE, BEVEL_FACE})


@pytest.mark.parametrize("view", RAW)
def test_a_raw_edge_lies_where_it_was_built(view: str) -> None:
    found = seen(view, "raw")
    assert_lies_along_the_part(found, *((0.05, 0.3) if view == "shaken" else (0.02, 0.06)))
    height = ((found.edge.upper_position_mm - found.edge.position_mm) * found.edge.across).sum(axis=1)
    assert np.nanmax(np.abs(height - 8.0)) < 0.05
