"""The chapter on a corrected finishing pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.conftest import bevel_sizes
from workbench.artefacts import Check, EdgeProfile, Inspection, PathCorrection, PathDeflection, Requirements, Section
from workbench.report import correction
from workbench.units import DEG

S = np.arange(-5.0, 66.0)


def found(refused: str | None = None) -> PathCorrection:
    full = np.ones(len(S))
    return PathCorrection(
        arc_length_mm=S,
        cut=(S >= 0) & (S <= 60),
        displacement_mm=0.31 * full,
        displacement_u_mm=0.02 * full,
        turn=0.01 * DEG * full,
        turn_u=0.03 * DEG * full,
        shift_mm=(0.0 if refused else -0.31) * full,
        tilt=0.0 * full,
        stock_mm=0.81 * full,
        bevel=40 * DEG,
        length_mm=60.0,
        allowance_mm=0.5,
        repeatability_mm=0.03,
        moved_mm=0.004,
        variation_mm=0.0,
        comes=PathDeflection({}),
        reason="shift corrected by -0.310 to -0.310 mm",
        refused=refused,
        checks=(Check("edge_moved_mm", 0.004, 0.3, refused is None, "why", refused or ""),),
    )


def part(root_mm: float, verdict: str) -> Inspection:
    s = np.linspace(0.0, 60.0, 61)
    full = np.ones(61)
    profile = EdgeProfile(s, np.zeros((61, 3)), full * root_mm, 0.01 * full, 40.0 * full, 0.03 * full)
    axes = np.eye(3)
    sizes = bevel_sizes(root_mm, 0.01, 40.0, 0.03)
    section = Section(1, 30.0, np.zeros(3), *axes, sizes, verdict, "", np.arange(3))  # type: ignore[arg-type]
    return Inspection((section,), profile, Requirements(), 1.645, verdict, "", "whole edge")  # type: ignore[arg-type]


def test_blind_and_corrected_stand_side_by_side() -> None:
    chapter = correction(found(), part(2.75, "fail"), part(1.51, "pass"), part(2.07, "fail"))
    assert "Without and with correction" in chapter.html
    assert "+0.570" in chapter.html
    assert "+0.010" in chapter.html
    assert "blind: mean root face deviation +0.570 mm; corrected: mean root face deviation +0.010 mm" in chapter.summary
    assert "hand-eye pose, tool setting" in chapter.html
    assert chapter.html.count("data:image/svg+xml") == 2
    assert chapter.verdict == ""


def test_before_the_finishing_pass_there_is_the_correction_alone() -> None:
    first = part(2.75, "fail")
    chapter = correction(found(), first, first, first)
    assert "Without and with correction" not in chapter.html
    assert chapter.html.count("data:image/svg+xml") == 1
    assert "−0.310 mm" in chapter.html


def test_a_refusal_is_told_and_its_words_are_text() -> None:
    first = part(1.2, "pass")
    chapter = correction(found("<b>the first cut lies 0.6 mm deeper"), first)
    assert chapter.verdict == "fail"
    assert chapter.summary.startswith("refused: ")
    assert "<b>the first" not in chapter.html
    assert "none: refused" in chapter.html


def test_what_was_not_cut_is_hatched() -> None:
    one = found()
    cut = one.cut & (np.arange(len(one.cut)) // 10 != 2)
    assert correction(replace(one, cut=cut), part(2.0, "fail")).html != correction(one, part(2.0, "fail")).html
