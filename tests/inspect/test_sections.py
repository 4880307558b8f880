"""Inspection of edges in sections: where they lie, what stays of hidden ones, how the part is judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.artefacts import DIRECTIONS, END, TANGENT, MilledEdge, Quantity, Unseen
from workbench.errors import PipelineError
from workbench.inspect import sections

Maker = Callable[..., MilledEdge]


@pytest.mark.parametrize("count", [1, 4, 9])
def test_sections_lie_in_the_middle_of_equal_parts(edge: Maker, count: int) -> None:
    part = edge()
    made = sections(part, sections=count)
    expected = (np.arange(1, count + 1) - 0.5) / count * 90.0
    np.testing.assert_allclose([s.arc_length_mm for s in made.sections], expected, rtol=0, atol=1e-9)
    assert [s.index for s in made.sections] == list(range(1, count + 1))
    for s in made.sections:
        np.testing.assert_allclose(s.origin_mm, [100 + s.arc_length_mm, 20, 30], rtol=0, atol=1e-9)
        np.testing.assert_allclose(np.stack([s.tangent, s.normal, s.across]), [[1, 0, 0], [0, -1, 0], [0, 0, 1]])
        near = part.frame_arc_length_mm[s.frames]
        assert (np.abs(near - s.arc_length_mm) <= 10.0).all()
        assert s.frames.size == pytest.approx(101, abs=45)


def test_hidden_sections_stay_without_values_and_undecided(edge: Maker) -> None:
    made = sections(edge(hidden_mm=(41.1, 51.7)), sections=9)
    hidden = made.sections[4]
    assert set(hidden.values.values()) == {None}
    assert (hidden.verdict, hidden.frames.size) == ("undecided", 0)
    assert "hidden" in hidden.reason
    np.testing.assert_allclose(hidden.origin_mm, [145, 20, 30], rtol=0, atol=1e-9)  # where it would be
    assert all(s.verdict == "pass" for s in made.sections if s is not hidden)
    assert made.verdict == "undecided"
    assert "section 5" in made.reason
    covered = np.isfinite(made.profile.root_mm)
    np.testing.assert_array_equal(np.flatnonzero(~covered), np.arange(42, 52))
    np.testing.assert_array_equal(np.isfinite(made.profile.bevel_deg), covered)


@pytest.mark.parametrize(
    ("changes", "verdict", "reason"),
    [
        ({}, "pass", "all 9 sections within tolerance"),
        ({"root": lambda s: np.where(s < 12, 0.9, 1.5)}, "fail", "1 of 9 sections fail: section 1: root face out of"),
        (
            {"bevel": lambda s: 41.5 + 0 * s},
            "fail",
            "9 of 9 sections fail: section 1: root face within",
        ),
        ({"root": lambda s: 2.0 + 0 * s}, "undecided", "9 of 9 sections undecided: section 1: root face too near a"),
        ({"bevel": lambda s: 39 + 0 * s, "bevel_u_deg": (0.3, 0.0)}, "undecided", "bevel angle too near a limit"),
        (
            {"root": lambda s: np.where(s > 40, 0.5, np.where(s < 12, 2.0, 1.5))},
            "fail",
            "5 of 9 sections fail: section 5: root face out of tolerance",
        ),
        ({"root": lambda s: np.where(s > 40, 2.0, 1.5)}, "undecided", "5 of 9 sections undecided: section 5: root"),
    ],
)
def test_the_part_is_judged_by_its_worst_section_and_the_first_such_is_named(
    edge: Maker, changes: dict[str, Any], verdict: str, reason: str
) -> None:
    made = sections(edge(**changes), sections=9)
    assert made.verdict == verdict
    assert reason in made.reason
    assert ("bevel angle out of tolerance" in made.reason) is ("bevel" in changes and verdict == "fail")


def test_requirements_and_guard_band_are_the_callers(edge: Maker) -> None:
    part = edge(root=lambda s: 2.4 + 0 * s, bevel=lambda s: 35 + 0 * s)
    own: dict[str, Any] = {
        "root_nominal_mm": 2.5,
        "root_tolerance_mm": (-0.2, 0.0),
        "bevel_nominal_deg": 35.0,
        "bevel_tolerance_deg": (-2.0, 2.0),
    }
    made = sections(part, **own)
    assert made.verdict == "pass"
    assert (made.requirements.root_nominal_mm, made.requirements.root_tolerance_mm) == (2.5, (-0.2, 0.0))
    assert made.guard_factor == 1.645
    assert sections(part).verdict == "fail"
    u = made.sections[0].values["root_u_mm"]
    assert u is not None
    narrow = {**own, "root_tolerance_mm": (-0.1 - 3 * u, 0.0)}
    assert sections(part, **narrow, guard_factor=0.0).verdict == "pass"
    assert sections(part, **narrow, guard_factor=5.0).verdict == "undecided"


@pytest.mark.parametrize(
    "given", [{"root_tolerance_mm": (-500, 500)}, {"root_tolerance_mm": (-0.5, 500)}, {"bevel_tolerance_deg": (-60, 1)}]
)
def test_a_tolerance_in_another_unit_is_refused(edge: Maker, given: dict[str, Any]) -> None:
    with pytest.raises(PipelineError, match="expected a deviation from the nominal size, in mm or deg, of at most 50"):
        sections(edge(), **given)


def test_failures_between_the_sections_are_told(edge: Maker) -> None:
    made = sections(edge(root=lambda s: 1.5 - 0.7 * np.exp(-(((s - 45) / 12) ** 2))), sections=2)
    assert made.verdict == "pass"
    assert any("between sections" in warning for warning in made.warnings)
    assert sections(edge()).warnings == ()
    assert sections(replace(edge(), warnings=("seen from one side",))).warnings == ("seen from one side",)


def test_axes_between_stations_are_of_unit_length(edge: Maker) -> None:
    part = edge()
    turn = 0.4 * part.arc_length_mm
    turning = replace(part, tangent=np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn]))
    assert [np.linalg.norm(one.tangent) for one in sections(turning, sections=4).sections] == pytest.approx([1.0] * 4)


def test_a_section_states_the_values_and_the_u_at_its_place(edge: Maker) -> None:
    def growing(first: float, last: float) -> Quantity:
        at = np.arange(91.0)
        return Quantity.of(
            "root_mm", 1.5 + at / 900.0, {END: np.interp(at, [0, 90], [first, last]), DIRECTIONS: 0.004 + 0 * at}
        )

    part = replace(edge(bevel=lambda s: 39.5 + s / 90.0), root=growing(0.003, 0.009))
    bevel = Quantity.of(
        "bevel_deg", part.bevel.value, {DIRECTIONS: np.linspace(0.3, 0.1, 91), TANGENT: 0.2 + np.zeros(91)}
    )
    made = sections(replace(part, bevel=bevel), sections=3)
    for one, s in zip(made.sections, [15.0, 45.0, 75.0], strict=True):
        assert one.values["root_mm"] == pytest.approx(1.5 + s / 900.0)
        assert one.values["root_u_mm"] == pytest.approx(np.hypot(0.003 + 0.006 * s / 90.0, 0.004))
        assert one.values["bevel_u_deg"] == pytest.approx(np.hypot(0.3 - 0.2 * s / 90.0, 0.2))
        assert one.values["bevel_deg"] == pytest.approx(39.5 + s / 90.0)
    for stated, size in ((made.profile.root_mm, part.root), (made.profile.bevel_deg, part.bevel)):
        np.testing.assert_array_equal(stated, size.value)
    told = {row["name"]: (row["root_u_mm"], row["bevel_u_deg"]) for row in made.sources}
    assert told[END] == pytest.approx((0.008, 0.0))  # the root face is known worst in the last section,
    assert told[DIRECTIONS] == pytest.approx((0.004, 0.3 - 0.2 / 6.0))  # the angle in the first
    assert told[TANGENT] == pytest.approx((0.0, 0.2))


def test_the_profile_states_what_each_source_adds_in_degrees_where_the_edge_is_seen(edge: Maker) -> None:
    profile = sections(edge(hidden_mm=(41.1, 51.7))).profile
    seen = np.isfinite(profile.root_mm)
    for u, by_source in (
        (profile.root_u_mm, profile.root_u_by_source_mm),
        (profile.bevel_u_deg, profile.bevel_u_by_source_deg),
    ):
        assert u[seen] == pytest.approx(0.005 if u is profile.root_u_mm else 0.05)
        parts = np.array(list(by_source.values()))
        assert np.hypot(*parts[:, seen]) == pytest.approx(u[seen])
        assert np.isnan(parts[:, ~seen]).all()


@pytest.mark.parametrize(
    ("root", "bevel_deg", "measured"),
    [(0.01, 40.0, True), (-0.01, 40.0, False), (1.5, 84.0, True), (1.5, 86.0, False), (1.5, -1.0, False)],
)
def test_what_a_bevel_can_have(edge: Maker, root: float, bevel_deg: float, measured: bool) -> None:
    made = sections(edge(root=lambda s: root + 0 * s, bevel=lambda s: bevel_deg + 0 * s))
    assert {bool(np.isfinite(size.value)) for one in made.sections for size in one.sizes.values()} == {measured}
    assert measured or made.verdict == "undecided"
    assert any("that no bevel has" in warning for warning in made.warnings) is not measured


def test_where_what_is_no_bevel_lies_and_where_it_fails_between_sections_is_told(edge: Maker) -> None:
    odd = sections(edge(root=lambda s: np.where((s > 20) & (s < 30), -1.0, 1.5)), sections=2)
    assert "between arc length 21.0 and 29.0 mm" in odd.warnings[0]
    thin = sections(edge(root=lambda s: np.where((s > 40) & (s < 50), 0.5, 1.5)), sections=2)
    assert thin.verdict == "pass"
    assert "at 9 places of the profile from arc length 41.0 to 49.0 mm" in thin.warnings[0]
    both = sections(edge(root=lambda s: np.where(s < 50, 0.5, 1.5)), sections=2)
    assert both.verdict == "fail"
    assert both.warnings == ()


LOST = Unseen("lost_columns", "A lost column.", {"root_mm": 0.07})
LAYER = Unseen("layer", "A layer.", {"root_mm": 0.001})
STOP = Unseen("lies_on", "A stop looks alike.", is_doubt=True)


def test_what_is_not_included_is_what_may_cost_more_than_u(edge: Maker) -> None:
    found = sections(replace(edge(), unseen=(LAYER, LOST)))
    assert found.uncertainty.not_included == (LOST,)
    assert found.verdict == "pass"
    assert found.conditions == ()
    cheap = sections(replace(edge(), unseen=(LAYER, replace(LAYER, costs={"root_mm": 0.0005}))))
    assert cheap.uncertainty.not_included == (LAYER,)


@pytest.mark.parametrize(
    ("unseen", "tolerance", "holds"),
    [
        *((LOST, 0.5, False), (LOST, 0.08, False), (LOST, 0.077, True), (STOP, 0.5, True), (LAYER, 0.02, False)),
        (replace(LOST, exchanges=True), 0.077, False),
    ],
)
def test_a_pass_rests_on_what_could_carry_it_out_of_its_limits(
    edge: Maker, unseen: Unseen, tolerance: float, holds: bool
) -> None:
    asked = {"root_tolerance_mm": (-tolerance, tolerance)}
    found = sections(replace(edge(), unseen=(unseen,)), **asked)
    assert {one.verdict for one in found.sections} == {"pass"}
    assert (found.conditions == (unseen,)) == holds
    assert found.verdict == ("undecided" if holds else "pass")
    assert found.reason.startswith("pass, provided that") == holds
    accepted = sections(replace(edge(), unseen=(unseen,)), **asked, accept_conditions=(unseen.name,))
    assert accepted.verdict == "pass"
    assert accepted.reason.endswith(f"; accepted by name: {unseen.name}") == holds
    assert any(one.startswith("accepted by name") for one in accepted.warnings) == holds


def test_nothing_but_a_pass_has_conditions(edge: Maker) -> None:
    for nominal in (2.0, 2.1):
        found = sections(replace(edge(), unseen=(STOP,)), root_nominal_mm=nominal)
        assert found.verdict != "pass"
        assert found.conditions == ()
