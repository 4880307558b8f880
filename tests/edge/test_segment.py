"""The edge as a whole: what was seen of it, and what is none. Where it lies and its sizes: tests/laws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.drawn.plates import random_recipe
from bench.recordings import frames
from tests.laws.dozen import ABOVE, plate
from tests.seldom import seldom
from workbench.artefacts import BEVEL_FACE, ROOT_FACE, MilledEdge
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.errors import InputError
from workbench.inspect import sections
from workbench.scan import fuse, read
from workbench.synthetic import simulate_recording

Scans = Callable[..., Any]
PARTS = [("two_pass", 1), ("clamps", 1)]
MORE = seldom(("paper", 1), ("wavy", 1), ("arc", 1), ("partial_view", 1), ("outliers_5", 3), ("robot_error", 1))


@pytest.mark.parametrize(("condition", "seed"), [*PARTS, *MORE])
def test_stations_and_what_was_seen(drawn: Scans, condition: str, seed: int) -> None:
    scan = drawn(condition, seed)
    edge, truth = scan.edge, scan.truth
    assert isinstance(edge, MilledEdge)
    assert edge.arc_length_mm[0] == 0
    np.testing.assert_allclose(np.diff(edge.arc_length_mm), 1.0, atol=0.05)
    step = np.linalg.norm(np.diff(edge.position_mm, axis=0), axis=1)
    np.testing.assert_allclose(
        step[np.isfinite(step)], np.diff(edge.arc_length_mm)[np.isfinite(step)], rtol=0.07
    )  # passes are apart by the robot
    np.testing.assert_array_equal(np.isfinite(edge.position_mm[:, 0]), edge.seen)
    really = truth.seen_at(edge.position_mm[edge.seen])
    assert really.mean() > 0.96  # within a station or so of the rims
    length = np.count_nonzero(truth.seen) * np.median(np.diff(truth.arc_length_mm))
    assert edge.seen.sum() > 0.93 * length - 4
    assert np.isfinite(edge.tangent).all()  # it goes on under a clamp
    assert edge.labels.shape == scan.cloud.keep.shape
    assert not edge.labels[~scan.cloud.keep].any()
    assert {ROOT_FACE, BEVEL_FACE} <= set(np.unique(edge.labels))


def test_expected_sizes_only_tell_the_faces_apart(drawn: Scans) -> None:
    scan = drawn("paper", 1)
    made = segment(scan.cloud, root_nominal_mm=1.3, bevel_nominal_deg=43.0)
    np.testing.assert_array_equal(made.labels, scan.edge.labels)
    np.testing.assert_array_equal(made.position_mm, scan.edge.position_mm)


def test_no_edge_in_view(drawn: Scans) -> None:
    cloud = drawn("paper", 1).cloud
    blank = replace(cloud, keep=np.zeros_like(cloud.keep), source="scan-7.h5")
    with pytest.raises(InputError, match=r"scan-7\.h5: no edge in view: expected a root face next to a bevel face"):
        segment(blank)


def test_passes_that_make_no_one_edge_are_refused_in_a_sentence() -> None:
    """A part that was moved by 30 mm before its second pass."""
    recording, _ = simulate_recording(random_recipe("two_pass", 7_900_010))
    recording = frames(recording, np.arange(len(recording.time_s)) % 4 == 0)
    moved = recording.robot_position_mm + np.where(recording.robot_pass == 1, 30.0, 0.0)[:, None] * [0.0, 0.0, 1.0]
    cloud = denoise(fuse(replace(recording, robot_position_mm=moved)))
    with pytest.raises(InputError, match=r"do not determine one smooth edge"):
        segment(cloud)


def test_passes_tell_together_which_face_is_the_root_face() -> None:
    """A thin plate of which neither surface is in view, its faces about as wide: one pass is misread by itself."""
    above = ABOVE | {"elevation_deg": 17.0}
    part = plate(above, above | {"elevation_deg": -3.0}, thickness_mm=1.5, root_mm=0.69)
    found = sections(segment(denoise(fuse(part.recording)), root_nominal_mm=0.83), root_nominal_mm=0.83).sections
    assert len(found) == 9
    for one in found:
        assert one.values["root_mm"] is not None
        assert one.values["root_u_mm"] is not None
        assert abs(one.values["root_mm"] - 0.69) < 3 * one.values["root_u_mm"] < 0.06


def test_a_pass_that_shows_no_order_of_its_frames_says_what_the_reverse_order_would_change() -> None:
    """Read in reverse, it is accepted, and has the values of the mirrored places: no recording of it tells."""
    recording = read(recording=Path("data/synthetic/milled_edge.h5"))
    backwards = replace(recording, x_mm=recording.x_mm[::-1], z_mm=recording.z_mm[::-1], intensity=None)
    one, other = (segment(denoise(fuse(each))) for each in (recording, backwards))
    mirrored = other.root.value[::-1] - np.interp(other.arc_length_mm, one.arc_length_mm, one.root.value)
    assert np.nanmax(np.abs(mirrored)) < 3.0 * float(np.nanmax(one.root.u))
    change = np.nanmax(np.abs(other.root.value - np.interp(other.arc_length_mm, one.arc_length_mm, one.root.value)))
    (stated,) = (unseen for unseen in one.unseen if unseen.name == "frame_order")
    assert stated.costs["root_mm"] == pytest.approx(change, abs=3.0 * float(np.nanmax(one.root.u)))
    assert stated.costs["root_mm"] > 2.0 * float(np.nanmedian(one.root.u))
