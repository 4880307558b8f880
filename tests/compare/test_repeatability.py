"""`compare.study` and `compare.repeatability`: files in, results out, what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from workbench.compare import repeatability, study
from workbench.errors import InputError

HEAD = "part,operator,trial,section,root_mm,root_u_mm\n"


def rows(*lines: str) -> str:
    return HEAD + "\n".join(lines) + "\n"


SMALL = rows(
    "P,A,1,1,1.50,0.01", "P,A,2,1,1.52,0.01", "P,B,1,1,1.46,0.01", "P,B,2,1,1.50,0.01", "P,reference,1,1,1.47,0.01"
)


def written(folder: Path, text: str, name: str = "study.csv") -> Path:
    (folder / name).write_text(text)
    return folder / name


def found(folder: Path, text: str, **settings: Any) -> Any:
    document, chapter = repeatability(study(study=written(folder, text), **settings))
    return json.loads(document.content), chapter


def test_values_by_hand(tmp_path: Path) -> None:
    """Two operators, two trials: EV, AV, bias and E_n worked out on paper."""
    result, chapter = found(tmp_path, SMALL, root_limits_mm=[1.0, 2.0])
    (root,) = result["characteristics"]
    sd = {part["name"]: part["sd"] for part in root["components"]}
    ev2 = (0.02**2 / 2 + 0.04**2 / 2) / 2
    av2 = (2 * 0.015**2 * 2 - ev2) / 2
    assert sd["EV"] == pytest.approx(ev2**0.5)
    assert sd["AV"] == pytest.approx(max(av2, 0.0) ** 0.5)
    assert sd["PV"] is None
    grr = next(part for part in root["components"] if part["name"] == "GRR")
    assert grr["tolerance_percent"] == pytest.approx(600 * (ev2 + max(av2, 0)) ** 0.5)
    (bias,) = root["bias"]
    assert bias["bias"] == pytest.approx(1.495 - 1.47)
    assert bias["u"] == pytest.approx((max(av2, 0) / 2 + ev2 / 4 + 0.01**2) ** 0.5)
    assert bias["largest_e_n"] == pytest.approx(0.05 / (2 * 2**0.5 * 0.01))
    assert "Root face" in chapter.html
    assert "of the tolerance" in chapter.summary


def inspection(root_mm: float | None, **more: Any) -> dict[str, Any]:
    rows = [
        {
            "index": k,
            "arc_length_mm": 10.0 * k,
            "origin_mm": [10.0 * k, 0, 0],
            "tangent": [1, 0, 0],
            "verdict": "pass",
            "root_mm": root_mm,
            "root_u_mm": 0.01,
            "bevel_deg": 40.0 + k,
            "bevel_u_deg": 0.02,
        }
        for k in (1, 2)
    ]
    wanted = {
        "root_nominal_mm": 1.5,
        "root_tolerance_mm": [-0.5, 0.4],
        "bevel_nominal_deg": 40,
        "bevel_tolerance_deg": [-1, 1],
    }
    columns = ("arc_length_mm", "position_mm", "root_mm", "root_u_mm", "bevel_deg")
    return {
        "format": "bevel-inspection",
        "version": 1,
        "frame": "base",
        "verdict": "pass",
        "reason": "",
        "guard_factor": 1.645,
        "sections": rows,
        "profile": {name: [] for name in columns},
        "requirements": wanted,
        **more,
    }


def test_inspections_of_directories(tmp_path: Path) -> None:
    """Directories of results in a study, limits out of the inspections; files alone are repeats by one operator."""
    for k, value in enumerate((1.5, 1.51, 1.49)):
        (tmp_path / f"run{k}").mkdir()
        written(tmp_path / f"run{k}", json.dumps(inspection(value)), "inspection.json")
    listed = written(tmp_path, "# three repeats\ninspection\nrun0\nrun1\nrun2/inspection.json\n")
    gathered = study(study=listed)
    assert gathered.limits == {"root_mm": (1.0, 1.9), "bevel_deg": (39.0, 41.0)}
    assert gathered.measured["root_mm"].shape == (1, 1, 3, 2)
    assert len({digest for _, digest in gathered.files}) == 3
    alone = study(inspections=[str(tmp_path / f"run{k}" / "inspection.json") for k in range(3)])
    np.testing.assert_array_equal(alone.measured["root_mm"], gathered.measured["root_mm"])
    result = json.loads(repeatability(gathered)[0].content)
    assert result["characteristics"][0]["components"][0]["sd"] == pytest.approx(0.01)


def test_what_all_inspections_agree_on_is_the_study_s_identity(tmp_path: Path) -> None:
    for k, part_id in enumerate(("A-7", "A-8")):
        part = {"part_id": part_id, "sensor": "LPS 36", "robot": None}
        written(tmp_path, json.dumps(inspection(1.5 + 0.01 * k, part=part)), f"{k}.json")
    document, chapter = repeatability(study(study=written(tmp_path, "inspection\n0.json\n1.json\n")))
    said = json.loads(document.content)["part"]
    assert (said["part_id"], said["sensor"], said["robot"]) == (None, "LPS 36", None)
    assert chapter.about == "instruments"


def test_a_hidden_section_is_left_out_and_told(tmp_path: Path) -> None:
    for k, value in enumerate((1.5, 1.51)):
        document = inspection(value)
        document["sections"][1]["root_mm"] = None if k else 1.5
        written(tmp_path, json.dumps(document), f"{k}.json")
    result = json.loads(repeatability(study(study=written(tmp_path, "inspection\n0.json\n1.json\n")))[0].content)
    assert [one["index"] for one in result["characteristics"][0]["sections"]] == [1]
    assert "section 2 left out" in result["warnings"][0]


def test_sections_at_other_places_are_told(tmp_path: Path) -> None:
    for k in range(2):
        document = inspection(1.5 + 0.001 * k)
        document["sections"][0]["arc_length_mm"] = 10.0 + 5.0 * k
        written(tmp_path, json.dumps(document), f"{k}.json")
    (words,) = study(study=written(tmp_path, "inspection\n0.json\n1.json\n")).warnings
    assert "2.5 mm off" in words


def test_a_gauge_that_hardly_tells_the_parts_apart_is_not_acceptable(tmp_path: Path) -> None:
    """Whatever its share of the tolerance."""
    rng = np.random.default_rng(6)
    lines = [f"{p},{o},{r},1,{1.5 + 0.01 * p + rng.normal(0, 0.01)}," for p in range(5) for o in "AB" for r in (1, 2)]
    _, chapter = found(tmp_path, rows(*lines), root_limits_mm=[1.0, 2.0])
    assert "not acceptable: ndc" in chapter.summary


REFUSED = {
    "unbalanced": (rows("P,A,1,1,1.5,0.01", "P,A,2,1,1.5,0.01", "P,B,1,1,1.5,0.01"), "operator 'B': expected 2 trials"),
    "one trial": (rows("P,A,1,1,1.5,0.01"), "two trials"),
    "text": (rows("P,A,1,1,wide,0.01"), "line 2, root_mm: expected a finite number, found 'wide'"),
    "infinite": (rows("P,A,1,1,inf,0.01"), "line 2, root_mm"),
    "negative u": (rows("P,A,1,1,1.5,-0.01"), "root_u_mm: expected a standard uncertainty from 0"),
    "section": (rows("P,A,1,0.5,1.5,0.01"), "whole number from 1"),
    "no trial": ("part,section,root_mm\nP,1,1.5\n", "line 2: expected a trial"),
    "twice": (rows("P,A,1,1,1.5,0.01", "P,A,1,1,1.5,0.01"), "occurs twice"),
    "cells": (rows("P,A,1,1"), "line 2: expected 6 cells, found 4"),
    "column": ("part,operater\nP,A\n", "line 1: 'operater': unknown column; did you mean 'operator'?"),
    "empty": ("", "is empty"),
    "both": ("inspection,section\na.json,1\n", "either an inspection or a section"),
    "missing file": ("inspection\nnone.json\n", "study.csv: line 2: {folder}/none.json: no such file"),
    "semicolons": ("part;operator;trial;section;root_mm\n", "header: expected cells parted by commas"),
    "other sections": (rows("P,A,1,1,1.5,0.01", "P,A,2,2,1.5,0.01"), "expected sections 1 to 1"),
    "copied": (
        rows(*(f"P{part},{by},1,1,{1.5 + 0.1 * part + 0.01 * (by == 'A')},0.01" for part in range(4) for by in "AB"))
        + "".join(f"P{part},{by},2,1,{1.51 + 0.1 * part},0.01\n" for part in range(4) for by in "AB"),
        "operator 'A', trial 2 repeats operator 'A', trial 1 figure by figure in all 4 values",
    ),
    "no values": ("part,operator,trial,section\nP,A,1,1\nP,A,2,1\n", "expected values of"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unusable_studies_are_refused_in_one_line(case: str, tmp_path: Path) -> None:
    text, words = REFUSED[case]
    with pytest.raises(InputError) as caught:
        study(study=written(tmp_path, text))
    assert words.replace("{folder}", str(tmp_path)) in str(caught.value)
    assert "\n" not in str(caught.value)


ROW, WANTED = inspection(1.5)["sections"][0], inspection(1.5)["requirements"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": "else"}, "$.format"),
        ({"sections": []}, "$.sections"),
        ({"sections": [ROW | {"root_mm": "x"}]}, "$.sections[0].root_mm: expected a valid number, got 'x'"),
        ({"sections": [ROW | {"root_u_mm": -1}]}, "$.sections[0].root_u_mm: expected"),
        ({"sections": [ROW, ROW]}, "$.sections: expected indices of their own"),
        ({"requirements": [1]}, "$.requirements"),
        ({"requirements": WANTED | {"root_tolerance_mm": 3}}, "$.requirements.root_tolerance_mm"),
    ],
)
def test_unusable_inspections_are_refused(change: dict[str, Any], words: str, tmp_path: Path) -> None:
    path = written(tmp_path, json.dumps(inspection(1.5) | change), "inspection.json")
    with pytest.raises(InputError) as caught:
        study(inspections=[str(path), str(path)])
    assert words in str(caught.value)


REAL = Path(__file__).parents[3] / "shared" / "data" / "real" / "gocator_gage_rr_minitab_ready.csv"
OTHERS = {"part": "SN", "operator": "Who", "trial": "Run"}


@pytest.mark.parametrize(
    ("in_radians", "settings", "words"),
    [
        (["reference"], {}, "bevel_deg is 0.698 by reference, 40 by A: .* in radians"),
        (["A", "B"], {}, "40 by reference, 0.698 by A: .* in radians"),
        (["B"], {}, "0.699 by B"),
        ([], {"bevel_limits_deg": (0.68, 0.716)}, "0.698 by its limits"),
        ([], {"root_limits_mm": (0.001, 0.002)}, "root_mm is 0.0015 by its limits, .* in metres"),
        ([], {"root_limits_mm": (0.04, 0.08)}, "root_mm is 0.06 by its limits, .* in inches"),
    ],
)
def test_one_study_has_one_unit(in_radians: list[str], settings: dict[str, Any], words: str, tmp_path: Path) -> None:
    """Values of one operator, of the reference, or limits in radians or metres: their biases were reported."""
    head, lines = "part,operator,trial,section,root_mm,bevel_deg\n", []
    for who, trial, off in (("A", 1, 0.0), ("A", 2, 0.01), ("B", 1, 0.02), ("B", 2, 0.04), ("reference", 1, 0.02)):
        lines.append(f"P,{who},{trial},1,{1.5 + off},{np.radians(40 + off) if who in in_radians else 40 + off}")
    with pytest.raises(InputError, match=words):
        study(study=written(tmp_path, head + "\n".join(lines)), **settings)


@pytest.mark.parametrize("mixed", ["", "B measured P1 as P3, P3 as P1", "sections of B run the other way"])
def test_an_operator_who_took_parts_or_sections_for_others_is_named(mixed: str, tmp_path: Path) -> None:
    """It only showed as a large reproducibility."""
    lines = []
    for k in range(5 * 3 * 2 * 3):
        part, who, trial, section = k // 18, "ABC"[k // 6 % 3], k // 3 % 2 + 1, k % 3
        if who == "B":
            part = {1: 3, 3: 1}.get(part, part) if "P1" in mixed else part
            section = 2 - section if "sections" in mixed else section
        size = 1.5 + 0.1 * part + 0.05 * part * section + 0.01 * np.sin(7.0 * k)
        lines.append(f"P{k // 18},{who},{trial},{k % 3 + 1},{size},0.01")
    told = found(tmp_path, rows(*lines))[0]["warnings"]
    assert [mixed in words for words in told] == [True] * bool(mixed)


@pytest.mark.parametrize("slip", [1501.0, -1.5, 0.00151])
def test_a_single_value_of_another_size_is_named(tmp_path: Path, slip: float) -> None:
    """One in micrometres, or of the other sign, was a gauge's error: all studies with it passed as they were."""
    cells = [(p, o, r) for p in range(3) for o in "AB" for r in (1, 2)]
    sizes = {one: 1.5 + 0.02 * np.sin(7.0 * k) for k, one in enumerate(cells)}

    def studied() -> Any:
        return study(study=written(tmp_path, rows(*(f"P{p},{o},{r},1,{sizes[p, o, r]},0.01" for p, o, r in cells))))

    assert studied().trials == 2
    sizes[1, "B", 2] = 1.9  # an error of a gauge is one
    assert studied().trials == 2
    sizes[1, "B", 2] = slip
    with pytest.raises(InputError, match=f"part 'P1', operator 'B', trial 2, section 1: root_mm is {slip:g}, of"):
        studied()


def test_any_characteristic_of_any_table(tmp_path: Path) -> None:
    """A plain table with columns of its own: the same numbers as the same values in this project's columns."""
    rng = np.random.default_rng(5)
    gap = rng.normal(0, 1, 4)[:, None, None] + rng.normal(0, 0.1, 2)[:, None] + rng.normal(0, 0.05, (4, 2, 3))
    cells = [(p, o, r) for p in range(4) for o in range(2) for r in range(3)]
    plain = "Who,Run,SN,gap,flush\n" + "".join(f"{o},{r},{p},{gap[p, o, r]},{p}\n" for p, o, r in cells)
    ours = rows(*(f"{p},{o},{r},1,{gap[p, o, r]}," for p, o, r in cells))
    there, chapter = found(tmp_path, plain, characteristics=["gap"], columns=OTHERS, limits={"gap": [-5, 5]})
    here, _ = found(tmp_path, ours, root_limits_mm=[-5, 5])
    (mine,), (other,) = here["characteristics"], there["characteristics"]
    assert (other["name"], other["unit"], other["limits"]) == ("gap", "mm", [-5, 5])
    assert other["components"] == mine["components"]
    assert chapter.summary.startswith("gap: GRR")


@pytest.mark.parametrize(
    ("text", "settings", "message"),
    [
        ("Who,Run,SN,gap\n1,1,1,x\n", {"columns": OTHERS}, "line 2, gap: expected a finite number"),
        ("Who,Run,SN,gapp\n1,1,1,1\n", {"columns": OTHERS}, "no column 'gap'; did you mean 'gapp'?"),
        ("Who,Run,SN,gap\n1,1,1,1\n", {}, "name them with `columns`"),
        ("Who,Run,SN,gap\n1,1,1,1\n1,1,1,2\n", {"columns": OTHERS}, "occurs twice"),
        ("Who,Run,SN,gap\n1,1,1,1\n1,2,1,2\n", {"columns": OTHERS, "limits": {"gab": [0, 1]}}, "'gab' is not one"),
        (SMALL, {"columns": {"part": "operator"}, "characteristics": []}, "expected characteristics too"),
    ],
)
def test_a_plain_table_that_cannot_be_used(tmp_path: Path, text: str, settings: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        study(study=written(tmp_path, text), **{"characteristics": ["gap"], **settings})
    assert message in str(caught.value)


@pytest.mark.skipif(not REAL.exists(), reason="the real gauge study is not here")
def test_a_real_study_of_another_gauge() -> None:
    """10 parts x 3 operators x 3 trials; the values that its ANOVA with pooled interaction has."""
    document, _ = repeatability(
        study(
            study=REAL, characteristics=["C2_3_TP"], columns={"part": "SN", "operator": "Operators", "trial": "Trials"}
        )
    )
    (one,) = json.loads(document.content)["characteristics"]
    sd = {part["name"]: part["sd"] for part in one["components"]}
    assert [sd[name] for name in ("EV", "AV", "GRR", "PV")] == pytest.approx(
        [0.01472, 0.00477, 0.01547, 0.07100], abs=6e-6
    )
