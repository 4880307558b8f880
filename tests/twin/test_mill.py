"""Milling against the bevel that the path implies, injected errors, and injected mistakes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.program.paths import in_work_object
from tests.twin.conftest import CURVES, perfect_path, raw_recipe, travel_at
from workbench.api import pose_from, quaternion_from_rotation, rotation_from_quaternion, rotation_from_vector
from workbench.artefacts import Toolpath
from workbench.errors import InputError, PipelineError
from workbench.synthetic import Workpiece, milled_truth
from workbench.twin import mill
from workbench.units import DEG

INSIDE = slice(4, -4)  # stations away from the ends of the part


def milled(recipe, toolpath=None, **errors):
    made, engagement = mill(Workpiece(recipe), toolpath or perfect_path(recipe), **errors)
    return milled_truth(made), engagement


@pytest.mark.parametrize("name", CURVES)
def test_a_perfect_path_gives_the_bevel_that_was_asked_for(name):
    truth, engagement = milled(raw_recipe(CURVES[name]))
    assert np.abs(truth.root_mm - 1.5).max() < 0.002
    assert np.abs(truth.bevel_deg - 40).max() < 0.01
    assert engagement.warnings == ()
    sections = truth.position_mm[10:60:7] + 2.0 * truth.across[10:60:7]
    assert truth.root_mm_at(sections) == pytest.approx(np.full(8, 1.5), abs=0.002)
    assert truth.bevel_deg_at(sections) == pytest.approx(np.full(8, 40), abs=0.01)


def test_unfinished_layers_leave_a_greater_root(recipe):
    truth, _ = milled(recipe, perfect_path(recipe, heights=(3.0, 2.0)))
    assert truth.root_mm == pytest.approx(np.full(81, 1.5 + 2.0 / np.sin(40 * DEG)), abs=0.002)


# Mistakes in a path, each as (position, rotation matrices, truth) -> the same, wrong.


def tilted_about_the_cutters_axis(position, rotation, truth):
    """The 40 deg turned about z, as printed in the paper: the cutter stands upright."""
    t, n, m = truth.tangent[0], truth.normal[0], truth.across[0]
    upright = np.stack([-n, t, -m], axis=-1) @ rotation_from_vector(np.array([0, 0, 40 * DEG]))
    return position, np.broadcast_to(upright, rotation.shape)


def mirrored_to_the_lower_side(position, rotation, truth):
    return mirrored(position, rotation, truth.position_mm[0] + 4 * truth.across[0], truth.across[0])


def mirrored(position, rotation, origin, normal):
    flip = np.eye(3) - 2 * np.outer(normal, normal)
    return origin + (position - origin) @ flip, flip @ rotation * np.array([1, -1, 1])


@pytest.mark.parametrize(
    "mistake",
    [
        tilted_about_the_cutters_axis,
        mirrored_to_the_lower_side,
    ],
)
def test_a_mistake_in_the_path_cannot_be_missed(recipe, mistake):
    """Each is far out of any tolerance at every station, or ends in a crash; here mostly both."""
    toolpath, true = perfect_path(recipe), milled_truth(Workpiece(recipe))
    layers = []
    for layer in toolpath.layers:
        position, rotation = mistake(layer.position_mm, rotation_from_quaternion(layer.quaternion_wxyz), true)
        assert np.allclose(np.linalg.det(rotation), 1)
        quaternion = quaternion_from_rotation(np.array(rotation))
        layers.append(dataclasses.replace(layer, position_mm=position, quaternion_wxyz=quaternion))
    truth, engagement = milled(recipe, dataclasses.replace(toolpath, layers=tuple(layers)))
    wrong = ~(np.abs(truth.root_mm - 1.5) < 1.5) | ~(np.abs(truth.bevel_deg - 40) < 5)
    assert wrong[INSIDE].all()
    if mistake is not tilted_about_the_cutters_axis:
        assert any("at once" in warning for warning in engagement.warnings)


# Injected errors against closed forms: a shift s of the bevel along its outward normal makes the root s / sin(bevel)
# greater.


def test_deflection_and_offset_shift_the_bevel(recipe):
    true = milled_truth(Workpiece(recipe))
    outward = np.cos(40 * DEG) * true.normal[0] + np.sin(40 * DEG) * true.across[0]
    shifted = 1.5 + 0.3 / np.sin(40 * DEG)
    for errors in ({"deflection_mm": (-0.3, 0.0, 0.0)}, {"offset_mm": tuple(0.3 * outward)}):
        truth, _ = milled(recipe, **errors)
        assert truth.root_mm[INSIDE] == pytest.approx(np.full(73, shifted), abs=0.002)
        assert truth.bevel_deg[INSIDE] == pytest.approx(np.full(73, 40), abs=0.01)
    truth, _ = milled(recipe, deflection_mm=(0.0, 0.5, 0.5))  # along the feed, along the axis: the face stays
    assert truth.root_mm[INSIDE] == pytest.approx(np.full(73, 1.5), abs=0.002)


def test_rotation_about_the_feed_turns_the_bevel_about_the_middle_of_its_face(recipe):
    """A turn by +e about t = m x n leans m towards n: the angle is smaller, and so is the root."""
    t, e, half = milled_truth(Workpiece(recipe)).tangent[0], 0.5, (8 - 1.5) / np.cos(40 * DEG) / 2
    truth, _ = milled(recipe, rotation_deg=tuple(e * t))
    assert np.abs(truth.bevel_deg[INSIDE] - (40 - e)).max() < 0.01
    # the law of sines in the triangle of the face's middle and its two feet on the end face
    expected = 1.5 - half * np.sin(e * DEG) / np.sin((40 - e) * DEG)
    assert truth.root_mm[INSIDE] == pytest.approx(np.full(73, expected), abs=0.003)


def test_wear_grows_with_the_length_cut(recipe):
    """Five layers: in the last the radius has lost between 4/5 and all of the wear."""
    truth, _ = milled(recipe, wear_mm=0.2)
    lost = (truth.root_mm - 1.5) * np.sin(40 * DEG)
    assert lost == pytest.approx(np.linspace(0.16, 0.2, 81), abs=0.003)


def test_robot_noise_is_smooth_and_as_large_as_asked_for():
    recipe = raw_recipe({"length_mm": 600})
    toolpath = perfect_path(recipe, heights=(0.0,))
    found = np.array(
        [
            milled(recipe, toolpath, robot_noise_mm=0.1, robot_noise_length_mm=20, seed=seed)[0].root_mm
            for seed in range(4)
        ]
    )
    shift = (found - 1.5) * np.sin(40 * DEG)
    assert 0.08 < shift.std() < 0.12
    assert np.abs(np.diff(shift, axis=1)).max() < 0.5 * 0.1 * 5 / 20  # 0.5 mm apart, slopes below five sigma
    again = milled(recipe, toolpath, robot_noise_mm=0.1, robot_noise_length_mm=20, seed=2)[0].root_mm
    assert np.array_equal(again, found[2])


# Crashes.


def test_a_travel_through_the_part_is_reported(recipe):
    toolpath = perfect_path(recipe)
    clear, low = (dataclasses.replace(toolpath, travels=(travel_at(toolpath, lift),)) for lift in (6.0, -3.0))
    assert milled(recipe, clear)[1].warnings == ()
    warnings = milled(recipe, low)[1].warnings
    assert any(w.startswith("travel to layer 1: the cutter meets material") for w in warnings)


def test_a_worn_cutter_leaves_what_it_has_lost(recipe):
    truth, _ = milled(recipe, worn_mm=0.1)
    assert (truth.root_mm[INSIDE] - 1.5) * np.sin(40 * DEG) == pytest.approx(0.1, abs=0.003)


def test_each_layer_has_its_own_robot_error(recipe):
    """The same face cut again: the deeper of independent errors stays."""
    one, four = (
        milled(recipe, perfect_path(recipe, heights=(0.0,) * count), robot_noise_mm=0.1, seed=4)[0].root_mm
        for count in (1, 4)
    )
    assert (one - four)[INSIDE].max() > 0.02


def test_a_lift_that_is_too_low_over_an_uncut_stretch_is_reported(recipe):
    """The cutter goes on there at the depth of the layer."""
    path = perfect_path(recipe, depth_of_cut_mm=1.0)
    layer = path.layers[2]
    hidden = (layer.arc_length_mm > 10) & (layer.arc_length_mm < 30)
    uncut = dataclasses.replace(layer, cutting=layer.cutting & ~hidden, measured=~hidden)
    warnings = milled(recipe, dataclasses.replace(path, layers=(uncut,)))[1].warnings
    assert any("layer 3: the cutter meets material where the path does not cut" in w for w in warnings)


def test_a_path_beside_the_part_is_reported(recipe):
    truth, engagement = milled(recipe, offset_mm=(0.0, 0.0, 90.0))
    assert engagement.warnings == tuple(f"layer {k}: the cutter meets nothing" for k in range(1, 6))
    assert np.isnan(truth.root_mm).all()


def test_clamps_and_table_are_in_the_way():
    clamped = raw_recipe({"clamps": [{"from_mm": 18, "to_mm": 24}], "table_gap_mm": 25})
    warnings = milled(clamped)[1].warnings
    assert any("layer 1: the cutter runs" in w and "into a clamp at arc length" in w for w in warnings)
    assert not any("the table" in w for w in warnings)
    tabled = milled(raw_recipe({"table_gap_mm": 5}))[1].warnings
    # final layer: middle of the face 4.75 mm up, axis 5 sin(40) above, tip 15 cos(40) and its rim 5 sin(40) below
    depth = 15 * np.cos(40 * DEG) - 4.75 - 5
    assert tabled[-1].startswith(f"layer 5: the cutter runs {depth:.2f} mm into the table")
    assert all("into the table" in w for w in tabled)
    assert milled(raw_recipe({"table_gap_mm": 5}), tip_mm=6.0)[1].warnings == ()


# Form.


def test_what_is_given_stays_as_it_was_and_bytes_repeat(recipe):
    toolpath = perfect_path(recipe)
    first, _ = mill(Workpiece(recipe), toolpath, robot_noise_mm=0.05)
    before = first.cut.height_mm.copy()
    again, _ = mill(Workpiece(recipe), toolpath, robot_noise_mm=0.05)
    assert np.array_equal(again.cut.height_mm, before)
    deeper, _ = mill(first, toolpath, deflection_mm=(0.2, 0.0, 0.0))
    assert np.array_equal(first.cut.height_mm, before)
    assert (deeper.cut.times, first.cut.times) == (2, 1)
    assert milled_truth(deeper).root_mm[INSIDE] == pytest.approx(np.full(73, 1.5 - 0.2 / np.sin(40 * DEG)), abs=0.003)


def test_a_path_in_a_work_object_is_the_same_path(recipe):
    toolpath = perfect_path(recipe)
    work = pose_from(rotation_from_vector(np.array([0.3, -0.8, 1.1])), np.array([900.0, 50, 400]))
    made, engagement = mill(Workpiece(recipe), in_work_object(toolpath, work))
    same, expected = mill(Workpiece(recipe), toolpath)
    cut = same.cut.height_mm < same.cut.stock_mm
    assert np.abs(made.cut.height_mm - same.cut.height_mm)[cut].max() < 1e-3
    assert engagement.layers[2].chip_area_mm2 == pytest.approx(expected.layers[2].chip_area_mm2, abs=1e-6)


def test_unusable_input_is_refused(recipe):
    empty = Toolpath(perfect_path(recipe).cutter, (), (), 1.5, 40.0, 1.0, 1.0, 40.0)
    with pytest.raises(InputError, match="layers of two points"):
        mill(Workpiece(recipe), empty)
    with pytest.raises(PipelineError, match="robot_noise_mm"):
        mill(Workpiece(recipe), perfect_path(recipe), robot_noise_mm=-1.0)
