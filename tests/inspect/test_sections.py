"""Inspection of edges in sections: where they lie, what stays of hidden ones, how the part is judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from workbench.artefacts import Inspection, MilledEdge
from workbench.inspect import sections
from workbench.units import DEG, Float

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


def test_values_and_profile(edge: Maker) -> None:
    def root(s: Float) -> Float:
        return np.asarray(1.4 + 0.2 * s / 90)

    made = sections(edge(root=root, bevel=lambda s: (39.5 + s / 90) * DEG))
    for s in made.sections:
        assert s.root_mm == pytest.approx(1.4 + 0.2 * s.arc_length_mm / 90, abs=0.006)
        assert s.bevel_deg == pytest.approx(39.5 + s.arc_length_mm / 90, abs=0.25)
        assert s.bevel_u_deg is not None
        assert abs(s.bevel_deg - 39.5 - s.arc_length_mm / 90) < 3.5 * s.bevel_u_deg
    profile = made.profile
    assert profile.arc_length_mm.shape == profile.root_mm.shape == profile.bevel_u_deg.shape == (91,)
    np.testing.assert_allclose(profile.root_mm, root(profile.arc_length_mm), rtol=0, atol=0.01)
    at = made.sections[4].arc_length_mm
    assert profile.root_mm[45] == pytest.approx(made.sections[4].root_mm, abs=1e-9)
    assert profile.bevel_deg[45] == pytest.approx(made.sections[4].bevel_deg, abs=1e-9)
    assert at == 45.0


def test_hidden_sections_stay_without_values_and_undecided(edge: Maker) -> None:
    made = sections(edge(hidden_mm=(41.1, 51.7)), sections=9)
    hidden = made.sections[4]
    assert (hidden.root_mm, hidden.root_u_mm, hidden.bevel_deg, hidden.bevel_u_deg) == (None,) * 4
    assert (hidden.verdict, hidden.frames.size) == ("undecided", 0)
    assert "hidden" in hidden.reason
    np.testing.assert_allclose(hidden.origin_mm, [145, 20, 30], rtol=0, atol=1e-9)  # where it would be
    assert all(s.verdict == "pass" for s in made.sections if s is not hidden)
    assert made.verdict == "undecided"
    assert "section 5" in made.reason
    covered = np.isfinite(made.profile.root_mm)
    np.testing.assert_array_equal(np.flatnonzero(~covered), np.arange(42, 52))
    np.testing.assert_array_equal(np.isfinite(made.profile.bevel_deg), covered)


def verdict(part: MilledEdge, **parameters: object) -> Inspection:
    return sections(part, **parameters)  # type: ignore[arg-type]


def test_the_part_is_judged_by_its_worst_section(edge: Maker) -> None:
    assert sections(edge()).verdict == "pass"
    assert "9" in sections(edge()).reason
    thin = sections(edge(root=lambda s: np.where(s < 12, 0.9, 1.5)))
    assert [s.verdict for s in thin.sections].count("fail") in (1, 2)
    assert thin.verdict == "fail"
    assert "section 1" in thin.reason
    assert "root face out of tolerance" in thin.reason
    steep = sections(edge(bevel=lambda s: 41.5 * DEG + 0 * s))
    assert steep.verdict == "fail"
    assert "bevel angle out of tolerance" in steep.reason


def test_a_part_at_the_limit_is_undecided(edge: Maker) -> None:
    assert sections(edge(root=lambda s: 2.0 + 0 * s)).verdict == "undecided"
    assert sections(edge(bevel=lambda s: 39 * DEG + 0 * s, bevel_u=(0.3 * DEG, 0.0))).verdict == "undecided"


def test_requirements_and_guard_band_are_the_callers(edge: Maker) -> None:
    part = edge(root=lambda s: 2.4 + 0 * s, bevel=lambda s: 35 * DEG + 0 * s)
    own = {
        "root_nominal_mm": 2.5,
        "root_tolerance_mm": (-0.2, 0.0),
        "bevel_nominal_deg": 35.0,
        "bevel_tolerance_deg": (-2.0, 2.0),
    }
    made = verdict(part, **own)
    assert made.verdict == "pass"
    assert (made.requirements.root_nominal_mm, made.requirements.root_tolerance_mm) == (2.5, (-0.2, 0.0))
    assert made.guard_factor == 1.645
    assert sections(part).verdict == "fail"
    u = made.sections[0].root_u_mm
    assert u is not None
    narrow = {**own, "root_tolerance_mm": (-0.1 - 3 * u, 0.0)}
    assert verdict(part, **narrow, guard_factor=0.0).verdict == "pass"
    assert verdict(part, **narrow, guard_factor=5.0).verdict == "undecided"


def test_failures_between_the_sections_are_told(edge: Maker) -> None:
    made = sections(edge(root=lambda s: 1.5 - 0.7 * np.exp(-(((s - 45) / 12) ** 2))), sections=2)
    assert made.verdict == "pass"
    assert any("between sections" in warning for warning in made.warnings)
    assert sections(edge()).warnings == ()


def test_the_edges_own_warnings_are_handed_on(edge: Maker) -> None:
    part = replace(edge(), warnings=("seen from one side",))
    assert sections(part).warnings == ("seen from one side",)


def test_what_is_no_bevel_is_not_measured(edge: Maker) -> None:
    """Faces that were taken for others give sizes that no bevel has: they are not judged."""
    for wrong in ({"root": lambda s: -2.0 + 0 * s}, {"bevel": lambda s: 1.6 + 0 * s}):
        made = sections(edge(**wrong))
        assert made.verdict == "undecided"
        assert all(section.root_mm is None and section.bevel_deg is None for section in made.sections)
        assert any("that no bevel has" in warning for warning in made.warnings)


def test_the_budget_adds_up_to_the_largest_section(edge: Maker) -> None:
    made = sections(edge())
    for key in ("root_u_mm", "bevel_u_deg"):
        whole = max(getattr(s, key) for s in made.sections)
        assert np.sqrt(sum(getattr(one, key) ** 2 for one in made.uncertainty.sources)) == pytest.approx(
            whole, rel=1e-6
        )
