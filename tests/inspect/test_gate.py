"""The pipeline's decision follows from the part's verdict and what the pipeline rejects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import bevel_sizes
from workbench.artefacts import EdgeProfile, Inspection, Requirements, Section, Verdict
from workbench.errors import InputError
from workbench.inspect import gate


def inspection(verdict: Verdict) -> Inspection:
    none = np.empty(0)
    profile = EdgeProfile(none, np.empty((0, 3)), none, none, none, none)
    return Inspection((), profile, Requirements(), 1.645, verdict, "section 3: too small", "whole edge")


@pytest.mark.parametrize(("verdict", "passed"), [("pass", True), ("undecided", False), ("fail", False)])
def test_only_a_pass_passes_unless_told_otherwise(verdict: Verdict, passed: bool) -> None:
    made = gate(inspection(verdict))
    assert made.passed is passed
    assert verdict in made.reason
    assert "section 3: too small" in made.reason


def test_who_accepts_the_undecided_is_told_so() -> None:
    made = gate(inspection("undecided"), reject=["fail"])
    assert made.passed
    assert made.warnings == ("the pipeline lets a part through that is undecided",)
    assert made.warnings[0] in made.reason
    assert not gate(inspection("fail"), reject=["fail"]).passed
    assert gate(inspection("fail"), reject=[]).passed
    assert gate(inspection("pass"), reject=["fail"]).warnings == ()


@pytest.mark.parametrize(("u_mm", "words"), [(None, "none of 1 sections"), (118.0, "its root face is known to 236 mm")])
def test_what_was_not_measured_is_not_judged(u_mm: float | None, words: str) -> None:
    at = np.zeros(3)
    value = None if u_mm is None else 5.8
    one = Section(
        1, 10.0, at, at, at, at, bevel_sizes(value, u_mm, value, u_mm and 0.1), "undecided", "", np.empty(0, int)
    )
    with pytest.raises(InputError, match=words):
        gate(replace(inspection("undecided"), sections=(one,)))


def measured(root_u_mm: float | None, bevel_u_deg: float | None, **tolerances: tuple[float, float]) -> Inspection:
    """Three sections of such u, the third ten times as uncertain."""
    at = np.zeros(3)

    def section(times: float) -> Section:
        us = [None if u is None else times * u for u in (root_u_mm, bevel_u_deg)]
        return Section(1, 10.0, at, at, at, at, bevel_sizes(1.5, us[0], 40.0, us[1]), "pass", "", np.empty(0, int))

    required = replace(Requirements(), **tolerances)
    return replace(inspection("pass"), sections=(section(1.0), section(1.0), section(10.0)), requirements=required)


@pytest.mark.parametrize(
    ("root_u_mm", "bevel_u_deg", "words"),
    [
        (4.9, 0.1, None),
        (5.1, 0.1, "its root face is known to 10.2 mm only, the tolerance is 1 mm wide"),
        (0.1, 9.9, None),
        (0.1, 10.1, "its bevel angle is known to 20.2 deg only, the tolerance is 2 deg wide"),
        (0.1, None, "none of 3 sections could be measured"),
        (None, 0.1, "none of 3 sections could be measured"),
    ],
)
def test_a_median_u_of_ten_times_the_tolerance_is_no_measure(
    root_u_mm: float | None, bevel_u_deg: float | None, words: str | None
) -> None:
    part = measured(root_u_mm, bevel_u_deg, root_tolerance_mm=(-0.4, 0.6), bevel_tolerance_deg=(-1.5, 0.5))
    if words is None:
        assert gate(part).passed
        return
    with pytest.raises(InputError, match=words):
        gate(part)


def test_both_sizes_must_be_measured_over_the_share() -> None:
    root, bevel = (np.where(here, 1.5, np.nan) for here in (np.arange(10) < 8, np.arange(10) >= 2))
    profile = EdgeProfile(np.arange(10.0), np.zeros((10, 3)), root, root, bevel, bevel)
    part = replace(inspection("pass"), profile=profile)
    assert "only 60 % of the edge was measured, 67 % are required" in gate(part).reason
    allowed = gate(part, least_measured_share=0.6)
    assert allowed.passed
    assert allowed.warnings == ("the pipeline asks for 60 % of the edge only",)
    assert not gate(part, least_measured_share=0.61).passed
