"""The closed loop's figures from sections whose errors are known."""

from __future__ import annotations

import pytest

from bench.drawn.plates import RAW_CONDITIONS
from bench.metrology.loop.part import LoopResult
from bench.metrology.loop.summary import LOOP_CONDITIONS, loop_tables, summarise_loops, worst_loops


def case(root, milled, injected=1.5, bevel=40.0, u=0.01):
    nine = {
        "root_mm": root,
        "root_u_mm": u,
        "root_milled_mm": milled,
        "root_injected_mm": injected,
        "bevel_deg": bevel,
        "bevel_u_deg": 0.05,
        "bevel_milled_deg": 40.0,
    }
    return {key: [value] * 9 for key, value in nine.items()}


def part(seed, perfect=None, errors=None, warnings=()):
    cases = {"perfect": perfect or case(1.51, 1.505), "errors": errors or case(1.80, 1.79, injected=1.7)}
    told = {"perfect": list(warnings), "errors": []}
    cut = dict.fromkeys(cases, [True] * 9)
    return LoopResult(
        "raw_arc", seed, cases=cases, cut=cut, warnings=told, seconds={"planning": 1.0, "errors: milling": 2.0}
    )


def test_figures_of_known_sections():
    found = summarise_loops("raw_arc", [part(0), part(1, perfect=case(1.48, 1.5))])
    perfect, errors = found.cases["perfect"], found.cases["errors"]
    assert (perfect.root.median, perfect.root.worst) == (pytest.approx(0.015), pytest.approx(0.02))
    assert perfect.milled_root.worst == pytest.approx(0.005)
    assert errors.mean_off.worst == pytest.approx(0.1)
    assert errors.root_cover.share == 1.0
    assert errors.root_cover.bias == pytest.approx(0.01)
    assert (perfect.measured, perfect.sections, found.seconds) == (18, 18, 3.0)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"perfect": case(1.54, 1.535)}, "root, perfect"),
        ({"perfect": case(1.5, 1.5, bevel=40.2)}, "bevel, perfect"),
        ({"warnings": ["the cutter meets material"]}, "the mill warns"),
    ],
)
def test_the_worst_part_decides(changed, words):
    found = summarise_loops("raw_arc", [*(part(seed) for seed in range(200)), part(200, **changed)])
    assert f"raw_arc: {words}" in list(found.shortcomings)
    assert words in loop_tables([found], "command")


def test_what_the_uncertainty_does_not_cover_is_a_shortcoming():
    found = summarise_loops("raw_arc", [part(seed, errors=case(1.8, 1.75)) for seed in range(10)])
    assert "raw_arc: root within 2u, errors" in list(found.shortcomings)


def test_hidden_sections_and_refused_parts_are_told():
    hidden = case(1.51, 1.505)
    hidden["root_mm"] = [None, *hidden["root_mm"][1:]]
    refused = LoopResult("raw_arc", 3, refused="no raw edge in view")
    found = summarise_loops("raw_arc", [part(0, perfect=hidden), refused])
    assert (found.cases["perfect"].measured, found.cases["perfect"].sections) == (8, 9)
    assert "seed 3: refused: no raw edge in view" in loop_tables([found], "command")
    assert next(iter(worst_loops([part(7)], 1))).startswith("raw_arc, seed 7: inspected root - 1.5, mm: +0.0100")


def test_loops_are_run_under_raw_conditions():
    assert set(LOOP_CONDITIONS) <= set(RAW_CONDITIONS)


def test_sections_beside_what_is_not_cut_do_not_count():
    broken = case(1.5, 1.5)
    broken["root_mm"] = [4.0, *broken["root_mm"][1:]]
    result = part(0, perfect=broken)
    assert summarise_loops("raw_arc", [result]).cases["perfect"].root.worst == pytest.approx(2.5)
    result.cut["perfect"] = [False] + [True] * 8
    found = summarise_loops("raw_arc", [result]).cases["perfect"]
    assert found.root.worst == 0
    assert (found.sections, found.left_out) == (8, 1)
