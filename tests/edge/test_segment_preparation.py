"""Prepared edges of one plate are found, with their kind and sizes; another kind, or none, is refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from bench.confidently_wrong.shapes import SHAPES, shape_recording
from bench.joints import JOINTS, measured
from bench.recordings import frames
from bench.simulators.swept import SweptRecipe, simulate_swept
from tests.made import files_of
from tests.seldom import seldom
from workbench.artefacts import Preparation
from workbench.cloud import denoise
from workbench.edge import segment, segment_preparation
from workbench.errors import InputError, PipelineError
from workbench.inspect import preparation as inspect_preparation
from workbench.report import html
from workbench.report import preparation as report_preparation
from workbench.result_files import RESULT_FILES
from workbench.scan import fuse, read

SEED = 4712
RECORDING = "data/synthetic/milled_nose.h5"


@pytest.fixture(scope="module")
def cloud():
    recording = read(recording=RECORDING)
    return denoise(fuse(frames(recording, np.arange(0, len(recording.time_s), 5))))


@pytest.fixture(scope="module")
def nose(cloud) -> Preparation:
    return segment_preparation(cloud)


@pytest.mark.parametrize(
    ("simulator", "kind"),
    [("outside_plate", "compound"), ("plate", "nose"), *seldom(("plate", "bevel"), ("outside_plate", "J"))],
)
def test_kind_and_sizes_come_back(simulator: str, kind: str) -> None:
    inspection, rows = measured(JOINTS[simulator][1](kind, SEED))
    assert inspection.type == kind
    assert {"root_face_mm", "bevel_deg", "depth_mm", "width_mm"} <= {size for size, _, _ in rows}
    z = np.array([abs(error) / u for _, error, u in rows])
    assert np.median(z) < 1.5  # the values of one part hang together: its share within 2 u tells little
    assert z.max() < 4.0


def test_an_oblique_scan_of_a_twisted_wavy_plate_tells_its_square_section() -> None:
    part = {
        "preparation": "compound",
        "spine": {"shape": "wavy", "length_mm": 100, "amplitude_mm": 1.0, "wavelength_mm": 200},
        "twist_deg": {"start": 0.0, "end": 4.0},
        "thickness_mm": 10,
        "bevel_deg": 45,
        "upper_bevel_deg": 65,
    }
    recipe = {
        "simulator": "swept",
        "part": part,
        "scanner": {"columns": 800, "pitch_mm": 0.05, "noise": {"sd_mm": 0.002}},
        "passes": [{"way_mm": [2, 98], "elevation_deg": 50, "oblique_deg": 5, "lead_deg": 5, "aim_mm": [-6, 5]}],
    }
    recording, truth = simulate_swept(SweptRecipe.model_validate(recipe))
    found = segment_preparation(denoise(fuse(recording)))
    at = [int(np.argmin(np.linalg.norm(truth.position_mm - place, axis=1))) for place in found.origin_mm]
    for name, most in (("depth_mm", 0.002), ("width_mm", 0.002), ("lower_bevel_mm", 0.002), ("bevel_deg", 0.02)):
        assert np.nanmax(np.abs(found.sizes[name].value - truth.preparation[name][at])) < most, name


@pytest.mark.parametrize("shape", list(SHAPES)[::3])
def test_what_is_no_plate_is_refused(shape: str) -> None:
    with pytest.raises(InputError):
        segment_preparation(denoise(fuse(shape_recording(shape, 0))))


def test_another_kind_than_is_seen_is_refused(cloud) -> None:
    with pytest.raises(InputError, match=r"preparation 'J'.*a bevel above a land: expected nose"):
        segment_preparation(cloud, preparation="J")
    assert segment_preparation(cloud, preparation="nose").declared


def test_a_plate_without_its_upper_surface_in_view_or_right_above_a_table_is_refused(cloud) -> None:
    with pytest.raises(InputError, match=r"upper surface|prepared plate"):
        segment_preparation(denoise(fuse(read(recording="data/synthetic/raw_edge.h5"))))
    along = np.repeat(np.radians([-38.6, 20.8, -38.6, 51.4, -38.6]), [110, 230, 40, 20, 200])
    x, z = 0.06 * np.cumsum([np.cos(along), np.sin(along)], axis=1)
    z = z + np.random.default_rng(2).normal(0.0, 0.01, (len(cloud.keep), z.size))
    drawn = replace(cloud, x_mm=np.tile(x, (len(z), 1)), z_mm=z, keep=np.ones(z.shape, bool))
    with pytest.raises(InputError, match="it lies on a table or right above it"):
        segment_preparation(drawn)


def test_two_plates_are_refused() -> None:
    with pytest.raises(InputError, match="two_plates_share"):
        segment_preparation(denoise(fuse(read(recording="data/synthetic/groove.h5"))))


def scanned(part: dict[str, object], columns: int = 600, pitch_mm: float = 0.045):
    """A short straight plate of the swept simulator, scanned once: cloud and truth."""
    recipe = {
        "simulator": "swept",
        "part": {"spine": {"length_mm": 60}, **part},
        "scanner": {"columns": columns, "pitch_mm": pitch_mm},
        "passes": [{"way_mm": [2, 58], "elevation_deg": 48, "lead_deg": 4, "aim_mm": [-4, 4]}],
    }
    recording, truth = simulate_swept(SweptRecipe.model_validate(recipe))
    return denoise(fuse(recording)), truth


@pytest.mark.parametrize(
    ("kind", "radius_mm"), [("bevel", 0.0), ("compound", 0.12), *seldom(("bevel", 0.12), ("compound", 0.0))]
)
def test_a_pass_from_below_fixes_the_lower_edge_of_a_preparation(kind: str, radius_mm: float) -> None:
    """It shows neither the upper surface nor, of a compound bevel, the upper one."""
    from_above = {"way_mm": [2, 58], "elevation_deg": 50, "lead_deg": 4, "aim_mm": [-4, 4]}
    from_below = {"way_mm": [58, 2], "elevation_deg": -12, "lead_deg": 2, "aim_mm": [-1, 1]}
    part = {"preparation": kind, "spine": {"length_mm": 60}, "lower_radius_mm": radius_mm}
    recipe = {"simulator": "swept", "part": part, "scanner": {"columns": 700, "pitch_mm": 0.045}}
    recipe |= {"passes": [from_above, from_below]}
    recording, truth = simulate_swept(SweptRecipe.model_validate(recipe))
    cloud = denoise(fuse(recording))
    both, alone = segment_preparation(cloud), segment_preparation(cloud.of_frames(cloud.pass_index == 0))
    assert not any("left out" in one for one in both.warnings)
    root, by_one = both.sizes["root_face_mm"], alone.sizes["root_face_mm"]
    assert (root.u < 0.5 * by_one.u).all()
    at = [int(np.argmin(np.linalg.norm(truth.position_mm - place, axis=1))) for place in both.origin_mm]
    assert (np.abs(root.value - truth.root_mm[at]) < 3.0 * root.u).all()
    for name in ("bevel_deg", "depth_mm", "width_mm"):
        assert np.nanmedian(both.sizes[name].u) < 1.1 * np.nanmedian(alone.sizes[name].u), name


ROUNDED = {"preparation": "bevel", "thickness_mm": 4, "root_mm": 1.1, "bevel_deg": 64, "middle_radius_mm": 0.8}
BOWED = {"preparation": "bevel", "thickness_mm": 9, "root_mm": 1.8, "bevel_deg": 46, "bevel_bow_mm": -0.2}
HOLLOW = {
    "preparation": "compound",
    "thickness_mm": 7,
    "root_mm": 3.2,
    "bevel_deg": 52,
    "upper_bevel_deg": 24,
    "lower_bevel_mm": 2.1,
    "bevel_bow_mm": -0.09,
}
FILLED = {"preparation": "nose", "land_mm": 1.5, "middle_radius_mm": 0.8}
COARSE = {"preparation": "nose", "land_mm": 0.45, "thickness_mm": 12, "root_mm": 4.5, "bevel_deg": 34}


@pytest.mark.parametrize(
    ("part", "pitch_mm", "suspicion"),
    [
        ({"preparation": "nose", "land_mm": 0.2}, 0.045, "corner_stands_out_mm"),
        (ROUNDED, 0.045, r"face_columns|face_bow"),
        (BOWED, 0.045, r"face_bow|upper surface"),
        (HOLLOW, 0.045, r"fillet_misfit_mm|upper surface"),
        (FILLED, 0.045, "upper surface"),
        (COARSE, 0.07, r"face_columns|clear of its corners"),
    ],
    ids=["ledge", "rounded corner", "bowed bevel", "hollow corner", "filled corner", "few columns"],
)
def test_what_is_no_straight_face_is_none(part: dict[str, object], pitch_mm: float, suspicion: str) -> None:
    cloud, _ = scanned(part, pitch_mm=pitch_mm)
    with pytest.raises(InputError, match=suspicion):
        segment_preparation(cloud, root_nominal_mm=part.get("root_mm", 1.5))


def test_an_x_preparation_without_its_upper_surface_is_no_bevel() -> None:
    """Its upper bevel was taken for the upper surface, its root face for the bevel: the depth 5.8 mm off."""
    with pytest.raises(InputError, match="between two bevels"):
        measured(JOINTS["x_plate"][1]("bevel", 2))
    _, rows = measured(JOINTS["x_plate"][1]("bevel", 3))  # turned round, its upper surface is in view
    assert max(abs(error) / u for _, error, u in rows) < 3.0


def test_the_root_face_is_told_from_the_upper_surface(cloud, nose) -> None:
    up = tuple(np.nanmean(nose.across, axis=0).tolist())
    told = segment_preparation(cloud, upper_side=up)
    assert np.array_equal(told.sizes["root_face_mm"].value, nose.sizes["root_face_mm"].value, equal_nan=True)
    with pytest.raises(InputError, match="upper_side"):
        segment_preparation(cloud, upper_side=tuple(-one for one in up))


def test_what_edge_segment_refuses_points_here(cloud) -> None:
    with pytest.raises(InputError, match=r"inspect_preparation\.json"):
        segment(cloud)


def test_sizes_are_judged_and_written(cloud, nose) -> None:
    wanted = {"land_mm": 1.2, "land_tolerance_mm": [-0.1, 0.1], "bevel_deg": 40, "bevel_tolerance_deg": [-1, 1]}
    judged = inspect_preparation(nose, nominal=wanted, accept_conditions=("window_end",))
    assert judged.verdict == "pass"
    document = json.loads(files_of(judged)["preparation.json"])
    RESULT_FILES["preparation.json"].model_validate(document)
    largest = max(section["land_u_mm"] for section in document["sections"])
    parts = sum((row.get("land_u_mm") or 0.0) ** 2 for row in document["uncertainty"]["sources"])
    assert math.sqrt(parts) == pytest.approx(largest, rel=0.02)
    corners = {corner["name"]: corner["section_mm"] for corner in document["sections"][4]["corners"]}
    assert corners["middle"][0] - corners["root"][0] == pytest.approx(-1.2, abs=0.02)
    text = html((report_preparation(cloud, nose, judged),)).content.decode()
    assert "Preparation type <b>nose</b>" in text
    assert "Land" in text


def test_a_size_that_no_preparation_has_is_refused(nose) -> None:
    with pytest.raises(PipelineError, match=r"inspect.preparation.nominal: lnd_mm.*land_mm"):
        inspect_preparation(nose, nominal={"lnd_mm": 1.0})
