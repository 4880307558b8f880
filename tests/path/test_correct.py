"""The finishing pass corrected by a measured first cut, on parts whose truth is known."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made import files_of
from tests.path.conftest import Raw
from tests.program.paths import in_work_object
from workbench.api import pose_from, rotation_from_quaternion, rotation_from_vector
from workbench.artefacts import (
    ChainU,
    EdgeProfile,
    Inspection,
    Layer,
    PathCorrection,
    PathDeflection,
    Requirements,
    Toolpath,
)
from workbench.errors import InputError
from workbench.path import check, correct, feed, layers
from workbench.path.batch import known_batch
from workbench.units import DEG, Float

ROOT, BEVEL, ALLOWANCE = 1.5, 40.0, 0.5
FIRST_ROOT = ROOT + ALLOWANCE / math.sin(BEVEL * DEG)
SINE = math.sin(BEVEL * DEG)
QUIET = {"repeatability_mm": 0.005}


@pytest.fixture(scope="module")
def scan(request: pytest.FixtureRequest) -> Raw:
    return request.getfixturevalue("raw")()


@pytest.fixture(scope="module")
def plan(scan: Raw) -> Toolpath:
    return feed(layers(scan.edge, scan.cloud, finish_allowance_mm=ALLOWANCE), scan.cloud, scan.edge)


def inspected(
    scan: Raw, root_mm: Any, bevel_deg: Any = BEVEL, moved_mm: float = 0.0, u_mm: float = 0.006
) -> Inspection:
    """What an inspection says of a part that was cut with this root face and angle, values along the edge or one."""
    edge = scan.edge
    s = edge.arc_length_mm
    full = np.ones(len(s))
    position = edge.position_mm + moved_mm * edge.normal
    profile = EdgeProfile(s, position, full * root_mm, full * u_mm, full * bevel_deg, 0.02 * full)
    return Inspection((), profile, Requirements(), 1.645, "pass", "", "whole edge")


def tool_axes(path: Toolpath, layer: Layer) -> Float:
    """x, y and z of the tool in the base, as columns (n, 3, 3)."""
    work = path.base_from_workobject
    axes = rotation_from_quaternion(layer.quaternion_wxyz)
    return axes if work is None else np.asarray(work[:3, :3] @ axes)


def faces(path: Toolpath) -> tuple[Float, Float, Float]:
    """Root end (k, 3) of the final layer's face, its direction up (k, 3), where it cuts; and their arc lengths."""
    final = path.layers[-1]
    axis, cut = tool_axes(path, final)[:, :, 2], final.cutting
    foot = path.in_base(final.position_mm) + 0.5 * final.width_mm[:, None] * axis
    return foot[cut], -axis[cut], final.arc_length_mm[cut]


def test_a_path_in_a_work_object_is_corrected_alike(scan: Raw, plan: Toolpath) -> None:
    measured = inspected(scan, FIRST_ROOT + 0.3 / SINE, BEVEL + 0.2)
    work = in_work_object(
        plan, pose_from(rotation_from_vector(np.array([0.3, -0.8, 1.9])), np.array([800.0, -90, 300]))
    )
    here, there = (correct(measured, one, **QUIET)[0] for one in (plan, work))
    assert there.base_from_workobject is not None
    assert faces(there)[0] == pytest.approx(faces(here)[0], abs=1e-9)
    assert faces(there)[1] == pytest.approx(faces(here)[1], abs=1e-9)


def test_the_first_cut_leaves_the_allowance_and_its_last_layer_takes_as_much(scan: Raw, plan: Toolpath) -> None:
    assert plan.root_mm == pytest.approx(FIRST_ROOT)
    assert plan.layers[-1].height_mm == 0.0
    assert plan.layers[-2].height_mm == pytest.approx(ALLOWANCE)
    assert np.diff([layer.height_mm for layer in plan.layers[:-1]]) == pytest.approx(-1.0)
    finishing = plan.finishing
    assert (finishing.root_mm, [layer.height_mm for layer in finishing.layers]) == (ROOT, [ALLOWANCE, 0.0])
    b = -tool_axes(plan, plan.layers[-1])[:, :, 0]
    apart = ((plan.layers[-1].position_mm - finishing.layers[-1].position_mm) * b).sum(axis=1)
    assert apart[plan.layers[-1].cutting] == pytest.approx(ALLOWANCE, abs=1e-9)
    assert check(plan, scan.edge, scan.cloud).passed
    assert check(finishing, scan.edge, scan.cloud).passed, check(finishing, scan.edge, scan.cloud).reason
    alone = check(replace(finishing, before=()), scan.edge, scan.cloud)  # nothing was milled before it
    assert not alone.passed
    assert "enters the stock" in alone.reason


@pytest.mark.parametrize("off_mm", [0.3, -0.2])
def test_a_displaced_cut_moves_the_finishing_pass_against_it(scan: Raw, plan: Toolpath, off_mm: float) -> None:
    path, found = correct(inspected(scan, FIRST_ROOT + off_mm / SINE), plan, **QUIET)
    assert found.refused is None
    assert found.displacement_mm[found.cut] == pytest.approx(off_mm, abs=0.004)
    b = -tool_axes(plan, plan.finishing.layers[-1])[:, :, 0]
    moved = path.layers[-1].position_mm - plan.finishing.layers[-1].position_mm
    assert moved == pytest.approx(-off_mm * b, abs=0.004)
    assert np.array_equal(path.layers[-1].quaternion_wxyz, plan.finishing.layers[-1].quaternion_wxyz)
    assert found.stock_mm[found.cut] == pytest.approx(ALLOWANCE + off_mm, abs=0.004)
    assert [layer.height_mm for layer in path.layers] == ([ALLOWANCE, 0.0] if off_mm > 0 else [0.0])
    assert len(path.travels) == len(path.layers) + 1
    fed = feed(path, scan.cloud, scan.edge)
    assert check(fed, scan.edge, scan.cloud, None, found).passed
    assert not check(fed, scan.edge, scan.cloud).passed  # without its correction it is no path for this edge


def test_a_tilted_cut_turns_the_finishing_pass_about_the_root_end(scan: Raw, plan: Toolpath) -> None:
    path, found = correct(inspected(scan, FIRST_ROOT, BEVEL + 0.3), plan, **QUIET)
    assert found.turn[found.cut] / DEG == pytest.approx(0.3, abs=0.01)
    assert found.shift_mm == pytest.approx(0.0)
    foot, up, _ = faces(path)
    foot_before, up_before, _ = faces(plan.finishing)
    assert foot == pytest.approx(foot_before, abs=0.001)
    n, m = scan.truth.normal[0], scan.truth.across[0]
    angle = np.arctan2(-(up @ n), up @ m) / DEG
    assert np.arctan2(-(up_before @ n), up_before @ m) / DEG == pytest.approx(BEVEL, abs=0.01)
    assert angle == pytest.approx(BEVEL - 0.3, abs=0.02)
    assert check(feed(path, scan.cloud, scan.edge), scan.edge, scan.cloud, None, found).passed


def giving_way(plan: Toolpath, before: float) -> PathDeflection:
    """By 0.1 mm where the last layer's face is as wide as planned, the layers before it by so many times as much."""
    final = plan.layers[-1]
    width = np.where(final.cutting, final.width_mm, np.nan)
    by = {one.index: -0.1 * (1.0 if one is final else before) * one.width_mm / width for one in plan.layers}
    return PathDeflection({k: np.nan_to_num(np.stack([x, 0 * x, 0 * x], axis=1)) for k, x in by.items()})


def test_the_less_a_load_falls_with_the_stock_the_more_the_tool_gives_way(scan: Raw, plan: Toolpath) -> None:
    """Of what the layer before and the last one met, 1 mm and 0.5 mm: from no power of the stock to its first."""
    cut, shifts = inspected(scan, FIRST_ROOT - 0.2 / SINE), []
    for before in (1.0, math.sqrt(2.0), 2.0):
        _, found = correct(cut, plan, giving_way(plan, before), yield_share=0, **QUIET)
        shifts.append(found.shift_mm[found.cut].mean())
    assert (np.diff(shifts) > 0.01).all()


def test_a_cut_too_deep_leaves_less_load_and_the_robot_gives_way_less(scan: Raw, plan: Toolpath) -> None:
    """The cut lies 0.2 mm deeper; the tool gives way by 0.1 mm under 0.5 mm of stock, so by 0.06 mm under 0.3 mm.

    The layer before gave way by twice that under 1 mm: the last one met h = 0.5 + g(1) - g(h), more than 0.5 mm.
    """
    final, gave = plan.layers[-1], giving_way(plan, 2.0)
    cut = inspected(scan, FIRST_ROOT - 0.2 / SINE)
    _, found = correct(cut, plan, gave, **QUIET)
    load = 0.3 / 0.5 * plan.finishing.layers[-1].width_mm[found.cut] / final.width_mm[found.cut]
    assert load == pytest.approx(0.6 * 1.14, abs=0.02)  # the face is wider
    full, planned, before = (layer.width_mm[found.cut] for layer in (plan.finishing.layers[-1], final, plan.layers[-2]))
    wider = 0.2 / 0.5 * (full - planned)  # the first cut's face than planned: it lies deeper
    as_cut = 1 + wider / planned
    met = (0.5 + 0.2 * before / planned * (1 + wider / before)) / (1 + 0.2 * as_cut)  # h = 0.5 + g(before) - g(h)
    assert found.shift_mm[found.cut] == pytest.approx(0.2 + 0.2 * met * as_cut - 0.1 * load, abs=0.006)
    assert found.stock_mm[found.cut] == pytest.approx(0.3, abs=0.004)
    _, unknown = correct(cut, plan, **QUIET)
    assert unknown.shift_mm[found.cut] == pytest.approx(0.2, abs=0.004)
    more = np.sqrt(unknown.displacement_u_mm**2 - correct(cut, plan, yield_share=0, **QUIET)[1].displacement_u_mm ** 2)
    assert more[found.cut] == pytest.approx(0.1 * 0.5 * (1 - load / as_cut) / math.sqrt(3), abs=0.001)
    with pytest.raises(InputError, match="that of this path"):
        correct(cut, plan, PathDeflection({}))


@pytest.mark.parametrize("off_mm", [0.0, 0.008])
def test_what_is_not_significant_is_not_corrected(scan: Raw, plan: Toolpath, off_mm: float) -> None:
    path, found = correct(inspected(scan, FIRST_ROOT + off_mm / SINE, BEVEL + 0.01), plan)
    assert not found.shift_mm.any()
    assert not found.tilt.any()
    assert "not significant" in found.reason
    assert np.array_equal(path.layers[-1].position_mm, plan.finishing.layers[-1].position_mm)


def test_a_cut_of_another_part_is_told(scan: Raw, plan: Toolpath) -> None:
    named, cut = (replace(plan.part, part_id=name) for name in ("plate 7", "plate 8"))
    path, found = replace(plan, part=named), inspected(scan, FIRST_ROOT + 0.1)
    other, own = (correct(replace(found, part=part), path, **QUIET)[1] for part in (cut, named))
    assert any("'plate 7', the cut of 'plate 8'" in said for said in other.warnings)
    assert not any("plate" in said for said in own.warnings)


def test_what_the_robot_repeats_is_corrected_place_by_place_and_what_it_does_not_is_left(scan, plan):
    s = scan.edge.arc_length_mm
    wave = 0.1 * np.sin(2 * np.pi * s / 60.0)
    cut = inspected(scan, FIRST_ROOT + wave / SINE)
    _, found = correct(cut, plan, **QUIET)
    expected = np.interp(found.arc_length_mm, s, wave)
    inner = (found.arc_length_mm > 5) & (found.arc_length_mm < s[-1] - 5)
    assert found.shift_mm[inner] == pytest.approx(-expected[inner], abs=0.015)
    assert found.variation_mm > 0.02
    _, left = correct(cut, plan, repeatability_mm=0.1)
    assert left.variation_mm < 0.01
    assert np.abs(left.shift_mm).max() < 0.05


@pytest.mark.parametrize(
    ("off_mm", "words"),
    [(-0.55, r"lies up to 0\.5\d mm deeper than planned"), (1.15, r"lies up to 1\.[01]\d? mm higher than planned")],
)
def test_more_than_the_allowance_allows_is_refused(scan: Raw, plan: Toolpath, off_mm: float, words: str) -> None:
    s = scan.edge.arc_length_mm
    local = off_mm * np.exp(-(((s - 40.0) / 15.0) ** 2))  # at one end only
    path, found = correct(inspected(scan, FIRST_ROOT + local / SINE), plan, **QUIET)
    assert re.search(words, found.refused), found.refused
    assert not found.shift_mm.any()
    assert np.array_equal(path.layers[-1].position_mm, plan.finishing.layers[-1].position_mm)
    gate = check(path, scan.edge, scan.cloud, None, found)
    assert not gate.passed
    assert found.refused in gate.reason


def test_a_part_that_moved_is_refused(scan: Raw, plan: Toolpath) -> None:
    _, found = correct(inspected(scan, FIRST_ROOT, moved_mm=0.6), plan)
    assert found.refused is not None
    assert "has the part moved" in found.refused


def test_a_cut_that_was_hardly_measured_is_refused(scan: Raw, plan: Toolpath) -> None:
    cut = inspected(scan, FIRST_ROOT)
    root = np.where(cut.profile.arc_length_mm < 15.0, cut.profile.root_mm, np.nan)
    _, found = correct(replace(cut, profile=replace(cut.profile, root_mm=root)), plan)
    assert found.refused is not None
    assert "of what the finishing pass cuts" in found.refused


def test_a_cut_that_is_as_deep_as_the_finished_one_is_told(scan: Raw, plan: Toolpath) -> None:
    for root_mm, told in ((ROOT, True), (FIRST_ROOT - 0.3 / SINE, False), (FIRST_ROOT, False)):
        _, found = correct(inspected(scan, root_mm), plan, **QUIET)
        assert any("milled already" in said for said in found.warnings) == told


def test_a_trend_is_not_continued_beyond_what_was_measured(scan: Raw, plan: Toolpath) -> None:
    """Half of the edge shows a slope of 1 mm in a metre: held in the other half, whose u has what it would come to."""
    s = scan.edge.arc_length_mm
    slope = 1e-3 * (s - s[-1])
    cut = inspected(scan, FIRST_ROOT + (slope - 0.2) / SINE)
    root = np.where(s > 0.5 * s[-1], cut.profile.root_mm, np.nan)
    _, found = correct(replace(cut, profile=replace(cut.profile, root_mm=root)), plan, **QUIET)
    unseen = found.arc_length_mm < 0.4 * s[-1]
    at_middle = float(np.interp(0.5 * s[-1], s, slope - 0.2))
    assert found.displacement_mm[unseen] == pytest.approx(at_middle, abs=0.01)
    true = np.interp(found.arc_length_mm, s, slope - 0.2)
    assert (np.abs(found.displacement_mm - true)[unseen] < 2.0 * found.displacement_u_mm[unseen]).all()


def test_inputs_that_do_not_belong_together(scan: Raw, plan: Toolpath) -> None:
    cut = inspected(scan, FIRST_ROOT)
    with pytest.raises(InputError, match="finish_allowance_mm"):
        correct(cut, layers(scan.edge, scan.cloud))
    far = replace(cut, profile=replace(cut.profile, position_mm=cut.profile.position_mm + 50.0))
    with pytest.raises(InputError, match="expected that of the edge that this path milled"):
        correct(far, plan)
    back = replace(cut, profile=replace(cut.profile, position_mm=cut.profile.position_mm[::-1].copy()))
    with pytest.raises(InputError, match="runs against the planned one"):
        correct(back, plan)
    nowhere = replace(cut, profile=replace(cut.profile, root_mm=np.full_like(cut.profile.root_mm, np.nan)))
    with pytest.raises(InputError, match="nothing was measured"):
        correct(nowhere, plan)


@pytest.mark.parametrize("allowance", [0.05, 1.5])
def test_an_allowance_that_cannot_be_milled_is_refused(scan: Raw, allowance: float) -> None:
    with pytest.raises(InputError, match="finish_allowance_mm"):
        layers(scan.edge, scan.cloud, finish_allowance_mm=allowance)


def test_a_cut_farther_off_than_the_calibrations_say_is_told(scan: Raw, plan: Toolpath) -> None:
    stated = replace(plan, chain=ChainU(0.03, 0.0, ("tool",)), part=replace(plan.part, hand_eye_u_mm=0.05))
    for off_mm, told in ((0.05, False), (0.3, True)):
        _, found = correct(inspected(scan, FIRST_ROOT + off_mm / SINE), stated, **QUIET)
        assert any("hand-eye pose, tool and repeatability say 0.04 mm" in said for said in found.warnings) == told
        assert found.refused is None


# Parts of a batch.


def kept(found: PathCorrection, folder: Path) -> Path:
    """The correction.json that the next part of the batch names."""
    (folder / "correction.json").write_bytes(files_of(found)["correction.json"])
    return folder / "correction.json"


def unrepeated(s: Float, rng: np.random.Generator, sd: float = 0.03) -> Float:
    """What a robot does not repeat: exponentially correlated over 50 mm."""
    covariance = np.exp(-np.abs(s[:, None] - s) / 50.0)
    return np.asarray(sd * np.linalg.cholesky(covariance + 1e-9 * np.eye(len(s))) @ rng.normal(size=len(s)))


def test_what_repeats_from_part_to_part_is_told_by_all_of_them(scan: Raw, plan: Toolpath, tmp_path: Path) -> None:
    """From the sixth part on the correction errs by at most 0.6 of what one part alone tells, and u holds."""
    s, rng, off = scan.edge.arc_length_mm, np.random.default_rng(11), {"alone": [], "batch": []}
    within = []
    for _ in range(2):
        earlier = None
        for part in range(8):
            cut = inspected(scan, FIRST_ROOT + (0.3 + unrepeated(s, rng)) / SINE, u_mm=0.002)
            _, found = correct(cut, plan, wear_mm=0.0, earlier=earlier)
            assert found.batch.parts == part + 1
            assert not found.warnings
            earlier = kept(found, tmp_path)
            if part >= 5:
                _, alone = correct(cut, plan, wear_mm=0.0)
                for name, one in (("alone", alone), ("batch", found)):
                    off[name].append(np.sqrt(np.mean((one.shift_mm[one.cut] + 0.3) ** 2)))
                within.append(np.abs(found.shift_mm + 0.3)[found.cut] <= 2 * found.displacement_u_mm[found.cut])
    alone_mm, batch_mm = (float(np.sqrt(np.mean(np.square(off[name])))) for name in ("alone", "batch"))
    assert batch_mm < 0.6 * alone_mm
    assert np.mean(np.concatenate(within)) > 0.9


def test_what_is_one_parts_own_is_corrected_by_itself(scan: Raw, plan: Toolpath, tmp_path: Path) -> None:
    """Parts whose plans are off by 0.2 mm each in its own way: their own cuts tell, the mean hardly counts."""
    s, rng, earlier, off = scan.edge.arc_length_mm, np.random.default_rng(12), None, []
    for part in range(6):
        own = 0.2 * rng.normal()
        cut = inspected(scan, FIRST_ROOT + (0.3 + own + unrepeated(s, rng, 0.005)) / SINE)
        _, found = correct(cut, plan, earlier=earlier, **QUIET)
        earlier = kept(found, tmp_path)
        if part >= 2:
            off.append(np.abs(found.shift_mm[found.cut] + 0.3 + own).max())
    assert max(off) < 0.05


def test_another_tool_begins_a_new_batch(scan: Raw, plan: Toolpath, tmp_path: Path) -> None:
    s, rng, earlier = scan.edge.arc_length_mm, np.random.default_rng(13), None
    for part in range(8):
        cut = inspected(scan, FIRST_ROOT + (0.3 - 0.4 * (part == 7) + unrepeated(s, rng)) / SINE)
        _, found = correct(cut, plan, earlier=earlier)
        earlier = kept(found, tmp_path)
        assert any("a new batch begins" in said for said in found.warnings) == (part == 7)
    assert found.batch.parts == 1
    assert found.shift_mm[found.cut].mean() == pytest.approx(0.1, abs=0.08)  # by itself alone


def test_earlier_parts_of_another_path_are_refused(scan: Raw, plan: Toolpath, tmp_path: Path) -> None:
    cut = inspected(scan, FIRST_ROOT + 0.3 / SINE)
    _, found = correct(cut, plan)
    with pytest.raises(InputError, match=r"bevel_deg: expected the same first path, 40, found 35"):
        correct(cut, plan, earlier=kept(replace(found, bevel=35 * DEG), tmp_path))
    with pytest.raises(InputError, match="what its batch showed"):
        correct(cut, plan, earlier=kept(replace(found, batch=None), tmp_path))


def test_earlier_parts_whose_errors_need_not_repeat_are_refused(scan: Raw, plan: Toolpath, tmp_path: Path) -> None:
    """In another fixture, of another robot or cutter; and the part itself, which would count twice."""
    cut = inspected(scan, FIRST_ROOT + 0.3 / SINE)
    named = replace(plan, part=replace(plan.part, part_id="a", robot_serial="R1"))
    earlier = kept(correct(cut, named)[1], tmp_path)
    second = replace(named, part=replace(named.part, part_id="b"))
    assert correct(cut, second, earlier=earlier)[1].batch.parts == 2
    turned = pose_from(rotation_from_vector(np.array([0.0, 0.0, math.radians(60.0)])), np.zeros(3))
    thick = replace(second.cutter, diameter_mm=20.0)
    for path, said in (
        (named, "'a' is one of the parts before"),
        (replace(second, part=replace(second.part, robot_serial="R2")), "expected parts of the same, R2, found R1"),
        (replace(second, cutter=thick), "expected parts of the same, 20.0, found 10.0"),
        (in_work_object(second, turned), None),
    ):
        if said is None:  # a path that says where it is by a work object stands where it stood
            assert correct(cut, path, earlier=earlier)[1].batch.parts == 2
            path, said = replace(path, base_from_workobject=np.eye(4)), "mm away, and turned by 4"
        with pytest.raises(InputError, match=said):
            known_batch(earlier, path)
