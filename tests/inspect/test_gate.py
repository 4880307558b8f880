"""The pipeline's decision follows from the part's verdict and what the pipeline rejects."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.artefacts import EdgeProfile, Inspection, Requirements, Verdict
from workbench.inspect import gate


def inspection(verdict: Verdict) -> Inspection:
    none = np.empty(0)
    profile = EdgeProfile(none, np.empty((0, 3)), none, none, none, none)
    return Inspection((), profile, Requirements(), 1.645, verdict, "section 3: too small", "whole edge")


@pytest.mark.parametrize(("verdict", "passed"), [("pass", True), ("undecided", True), ("fail", False)])
def test_only_a_proven_failure_rejects_unless_told_otherwise(verdict: Verdict, passed: bool) -> None:
    made = gate(inspection(verdict))
    assert made.passed is passed
    assert verdict in made.reason
    assert "section 3: too small" in made.reason


def test_a_strict_gate_rejects_the_undecided_too() -> None:
    assert not gate(inspection("undecided"), reject=["fail", "undecided"]).passed
    assert not gate(inspection("fail"), reject=["fail", "undecided"]).passed
    assert gate(inspection("pass"), reject=["fail", "undecided"]).passed


def test_a_gate_that_rejects_nothing() -> None:
    assert gate(inspection("fail"), reject=[]).passed
