"""Joints whose sizes, axes and corners are known functions of arc length: what their sections state and refuse."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import Corner, Preparation, Quantity
from workbench.errors import InputError, PipelineError
from workbench.inspect import groove_gate, preparation

LENGTH_MM = 20.0
S = np.arange(LENGTH_MM + 1.0)
NOSE = {"land_mm": 2.0, "land_tolerance_mm": [-0.5, 0.5]}


def linear(start: float, end: float) -> np.ndarray:
    return start + (end - start) * S / LENGTH_MM


def joint(**changed: Any) -> Preparation:
    """A nose along base y at x = 500, its faces seen from above in 41 frames of 11 columns, columns running to -x."""
    ones = np.ones(S.size)
    up, outward = np.tile([0.0, 0.0, 1.0], (S.size, 1)), np.tile([1.0, 0.0, 0.0], (S.size, 1))
    pose = np.tile(np.eye(4), (41, 1, 1))
    pose[:, :3, 3] = np.column_stack([np.full(41, 495.0), np.linspace(0.0, LENGTH_MM, 41), np.full(41, 130.0)])
    return replace(
        Preparation(
            type="nose",
            declared=True,
            arc_length_mm=S,
            origin_mm=np.column_stack([500.0 * ones, S, 7.0 * ones]),
            tangent=np.tile([0.0, 1.0, 0.0], (S.size, 1)),
            normal=outward,
            across=up,
            seen=ones > 0,
            sizes={
                "land_mm": Quantity.of(
                    "land_mm", linear(1.9, 2.1), {"faces": linear(0.01, 0.03), "hand-eye": 0.04 * ones}
                ),
                "bevel_deg": Quantity.of(
                    "bevel_deg", linear(30.0, 32.0), {"faces": linear(0.3, 0.1), "hand-eye": 0.2 * ones}
                ),
            },
            corners={
                "lower": Corner(np.column_stack([-2.0 * ones, linear(3.0, 5.0)]), np.tile([0.02, 0.05], (S.size, 1)))
            },
            frame_arc_length_mm=np.linspace(0.0, LENGTH_MM, 41),
            x_mm=np.tile(np.linspace(10.0, -10.0, 11), (41, 1)),
            base_from_profiler=pose,
            pass_index=np.zeros(41, np.int64),
        ),
        **changed,
    )


def test_sections_lie_in_the_middle_of_equal_parts_and_state_what_is_there() -> None:
    made = preparation(joint(), nominal=NOSE, sections=4)
    assert [one.index for one in made.sections] == [1, 2, 3, 4]
    for one, s in zip(made.sections, [2.5, 7.5, 12.5, 17.5], strict=True):
        assert one.arc_length_mm == pytest.approx(s)
        assert one.values == pytest.approx(
            {
                "land_mm": 1.9 + 0.01 * s,
                "land_u_mm": np.hypot(0.01 + 0.001 * s, 0.04),
                "bevel_deg": 30.0 + 0.1 * s,
                "bevel_u_deg": np.hypot(0.3 - 0.01 * s, 0.2),
            }
        )
        assert [*one.origin_mm] == pytest.approx([500.0, s, 7.0])
        assert (one.verdict, one.reason) == ("pass", "land within tolerance")
    assert (made.verdict, made.reason) == ("pass", "all 4 sections within tolerance")


def test_axes_that_turn_along_the_joint_stay_of_unit_length() -> None:
    turn = np.radians(linear(0.0, 40.0))
    outward = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    forward = np.column_stack([-np.sin(turn), np.cos(turn), 0.0 * turn])
    for one in preparation(joint(normal=outward, tangent=forward), sections=7).sections:
        at = np.radians(2.0 * one.arc_length_mm)
        assert [*one.normal] == pytest.approx([np.cos(at), np.sin(at), 0.0], abs=1e-4)
        assert [*one.tangent] == pytest.approx([-np.sin(at), np.cos(at), 0.0], abs=1e-4)
        assert np.linalg.norm([one.normal, one.tangent, one.across], axis=1) == pytest.approx(np.ones(3))


def test_a_corner_is_told_in_the_section_in_the_base_and_by_its_column() -> None:
    for one in preparation(joint(), sections=4).sections:
        (corner,) = one.corners
        m = 3.0 + 0.1 * one.arc_length_mm
        assert corner["name"] == "lower"
        assert corner["section_mm"] == pytest.approx([-2.0, m])
        assert corner["u_mm"] == pytest.approx([0.02, 0.05])
        assert corner["position_mm"] == pytest.approx([498.0, one.arc_length_mm, 7.0 + m])
        assert corner["column"] == pytest.approx(3.5)  # x = 3 of the profiler, columns from 10 down by 2


@pytest.mark.parametrize(("x_mm", "column"), [(-10.0, 10.0), (10.0, 0.0), (-10.01, None), (10.01, None)])
def test_a_corner_beyond_the_columns_has_none(x_mm: float, column: float | None) -> None:
    at = Corner(np.column_stack([np.full(S.size, x_mm - 5.0), linear(3.0, 5.0)]), np.full((S.size, 2), 0.05))
    told = [one.corners[0]["column"] for one in preparation(joint(corners={"lower": at}), sections=3).sections]
    assert told == ([None] * 3 if column is None else pytest.approx([column] * 3))


def test_a_corner_that_is_not_known_there_is_not_told() -> None:
    whole = joint().corners["lower"]
    for part in (
        replace(whole, section_mm=np.where(S[:, None] < 10.0, np.nan, whole.section_mm)),
        replace(whole, u_mm=np.where(S[:, None] < 10.0, np.nan, whole.u_mm)),
    ):
        told = [len(one.corners) for one in preparation(joint(corners={"lower": part}), sections=4).sections]
        assert told == [0, 0, 1, 1]
    dark = preparation(joint(seen=S >= 10.0), sections=4)
    assert [len(one.corners) for one in dark.sections] == [0, 0, 1, 1]
    assert [one.values["land_mm"] is None for one in dark.sections] == [True, True, False, False]


def test_a_section_is_seen_where_both_stations_beside_it_are() -> None:
    for hidden, seen in ((9, True), (10, False), (11, False), (12, True)):
        values = preparation(joint(seen=hidden != S), sections=20).sections[10].values  # at 10.5 mm
        assert (values["land_mm"] is not None) is seen


@pytest.mark.parametrize(
    ("land", "verdict", "words"),
    [
        (2.0, "pass", "land within tolerance"),
        (2.49, "undecided", "land too near a limit to decide"),
        (2.8, "fail", "land out of tolerance"),
        (1.2, "fail", "land out of tolerance"),
    ],
)
def test_a_size_is_judged_with_its_guard_band(land: float, verdict: str, words: str) -> None:
    size = Quantity.of("land_mm", np.full(S.size, land), {"faces": np.full(S.size, 0.02)})
    made = preparation(joint(sizes={"land_mm": size}), nominal=NOSE, sections=3)
    assert made.verdict == verdict
    assert [(one.verdict, one.reason) for one in made.sections] == [(verdict, words)] * 3
    assert (words in made.reason) is (verdict != "pass")


def test_a_failing_section_is_named_before_an_open_one() -> None:
    land = np.select([S < 5.0, S < 10.0], [2.49, 2.0], 3.0)
    size = Quantity.of("land_mm", land, {"faces": np.full(S.size, 0.02)})
    made = preparation(joint(sizes={"land_mm": size}), nominal=NOSE, sections=4)
    assert [one.verdict for one in made.sections] == ["undecided", "pass", "fail", "fail"]
    assert made.reason == "2 of 4 sections fail: section 3: land out of tolerance"
    assert made.verdict == "fail"
    passing = replace(size, value=np.where(S < 5.0, 2.49, 2.0))
    undecided = preparation(joint(sizes={"land_mm": passing}), nominal=NOSE, sections=4)
    assert undecided.reason == "1 of 4 sections undecided: section 1: land too near a limit to decide"


@pytest.mark.parametrize("unseen", ["root_face", "depth"])
def test_what_is_required_and_not_seen_is_undecided_and_the_rest_judged(unseen: str) -> None:
    """Wherever it stands among the sizes."""
    wanted = {f"{unseen}_mm": 4, f"{unseen}_tolerance_mm": [-1, 1], "bevel_deg": 50.0, "bevel_tolerance_deg": [-1, 1]}
    made = preparation(joint(), nominal={**NOSE, **wanted}, sections=2)
    assert [one.verdict for one in made.sections] == ["fail"] * 2
    for words in ("not seen", "land within tolerance", "bevel angle out of tolerance"):
        assert words in made.sections[0].reason
    assert preparation(joint(), nominal={**NOSE, **dict([*wanted.items()][:2])}, sections=2).verdict == "undecided"


def test_each_source_is_told_in_the_section_where_its_size_is_known_worst() -> None:
    rows = {row["name"]: row for row in preparation(joint(), sections=4).sources}
    assert (rows["faces"]["kind"], rows["hand-eye"]["kind"]) == ("A", "B")
    assert rows["faces"]["land_u_mm"] == pytest.approx(0.01 + 0.02 * 17.5 / 20.0)
    assert rows["faces"]["bevel_u_deg"] == pytest.approx(0.3 - 0.2 * 2.5 / 20.0)
    assert rows["hand-eye"]["land_u_mm"] == pytest.approx(0.04)


def test_nothing_required_is_measured_and_let_through() -> None:
    made = preparation(joint(), sections=2)
    told = "no specification: measured, conformity not assessed"
    assert (made.verdict, made.reason) == ("undecided", told)
    assert made.sections[0].reason == told
    opened = groove_gate(made)
    assert opened.passed
    assert opened.warnings == (told,)
    assert not groove_gate(made, accept_unjudged=False).passed


def test_the_gate_rejects_all_but_a_pass_of_what_is_required() -> None:
    for land, passed in ((2.0, True), (2.49, False), (3.0, False)):
        size = Quantity.of("land_mm", np.full(S.size, land), {"faces": np.full(S.size, 0.02)})
        decided = groove_gate(preparation(joint(sizes={"land_mm": size}), nominal=NOSE))
        assert (decided.passed, decided.warnings) == (passed, ())


def test_a_joint_of_which_nothing_was_seen_is_refused() -> None:
    with pytest.raises(InputError, match="none of 9 sections could be measured"):
        preparation(joint(seen=S < 0.0))


def test_that_the_hand_eye_pose_is_exact_is_told_unless_its_u_is_known() -> None:
    part = joint().part
    unknown = preparation(joint(part=replace(part, hand_eye_u_mm=None))).uncertainty.not_included
    known = preparation(joint(part=replace(part, hand_eye_u_mm=0.05))).uncertainty.not_included
    assert [one for one in unknown if one not in known] == [unknown[-1]]
    assert unknown[-1].name == "hand_eye"


@pytest.mark.parametrize(
    ("nominal", "place", "words"),
    [
        ({"lend_mm": 2.0}, "lend_mm", "land_mm"),
        ({"land_tolerance_mm": [-0.5, 0.5]}, "land_tolerance_mm", "expected 'land_mm' beside it"),
        ({"land_mm": "two", "land_tolerance_mm": [-0.5, 0.5]}, "land_mm", "expected a number"),
        ({"land_mm": True, "land_tolerance_mm": [-0.5, 0.5]}, "land_mm", "expected a number"),
        ({"land_mm": float("nan"), "land_tolerance_mm": [-0.5, 0.5]}, "land_mm", "expected a number"),
        ({"land_mm": 2.0}, "land_tolerance_mm", "lower <= 0 <= upper"),
        ({"land_mm": 2.0, "land_tolerance_mm": 0.5}, "land_tolerance_mm", "lower <= 0 <= upper"),
        ({"land_mm": 2.0, "land_tolerance_mm": [-0.5]}, "land_tolerance_mm", "lower <= 0 <= upper"),
        ({"land_mm": 2.0, "land_tolerance_mm": [-0.5, 0.0, 0.5]}, "land_tolerance_mm", "lower <= 0 <= upper"),
        ({"land_mm": 2.0, "land_tolerance_mm": [-0.5, "x"]}, "land_tolerance_mm", "lower <= 0 <= upper"),
        ({"land_mm": 2.0, "land_tolerance_mm": [0.1, 0.5]}, "land_tolerance_mm", "lower <= 0 <= upper"),
        ({"land_mm": 2.0, "land_tolerance_mm": [-0.5, -0.1]}, "land_tolerance_mm", "lower <= 0 <= upper"),
        ({"land_mm": 2.0, "land_tolerance_mm": [-500, 500]}, "land_tolerance_mm", "at most 50"),
    ],
)
def test_requirements_that_cannot_be_judged_are_refused_with_their_place(
    nominal: dict[str, Any], place: str, words: str
) -> None:
    with pytest.raises(PipelineError) as refused:
        preparation(joint(), nominal=nominal)
    assert f"inspect.preparation.nominal: {place}:" in str(refused.value)
    assert words in str(refused.value)


@pytest.mark.parametrize("tolerance", [[-0.5, 0.0], [0.0, 0.5], (-0.5, 0.5)])
def test_a_limit_at_the_nominal_size_is_allowed(tolerance: Any) -> None:
    made = preparation(joint(), nominal={"land_mm": 2.0, "land_tolerance_mm": tolerance}, sections=1)
    assert [*made.requirements["land_tolerance_mm"]] == [*tolerance]
    assert made.verdict == ("pass" if all(tolerance) else "undecided")
