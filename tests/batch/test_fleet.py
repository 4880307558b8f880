"""The page and the table of a fleet: all parts, worst first, links that lead somewhere, and names as text only."""

import base64
import io
from urllib.parse import unquote

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.report.conftest import Elements
from workbench.batch.fleet import (
    cover,
    fleet_files,
    page,
    without_folders,
    worst_first,
)
from workbench.batch.part import Record
from workbench.batch.run import Batch, print_batch

NEEDS = {
    "root_nominal_mm": 1.5,
    "root_tolerance_mm": [-0.5, 0.5],
    "bevel_nominal_deg": 40.0,
    "bevel_tolerance_deg": [-1, 1],
}


def part(name: str, roots: list[float | None], verdict: str = "pass", **more: object) -> Record:
    sections = tuple(
        {
            "index": i,
            "arc_length_mm": 10.0 * i,
            "root_mm": root,
            "root_u_mm": root and 0.01,
            "bevel_deg": root and 40.2,
            "bevel_u_deg": root and 0.02,
            "verdict": verdict,
        }
        for i, root in enumerate(roots, 1)
    )
    outcome = "rejected" if verdict == "fail" else "passed"
    given = {"outcome": outcome, "files": {"report.html": "0"}, **more}
    return Record(name, f"{name}.h5", verdict=verdict, requirements=NEEDS, sections=sections, **given)  # type: ignore[arg-type]


FLEET = [
    part("fine", [1.5, 1.52, 1.5]),
    part("near", [1.5, 1.05, 1.5]),
    part("open", [1.5, None, 1.2], "undecided"),
    part("thin", [1.5, 0.9, 1.4], "fail", cause="fail: section 2"),
    Record("torn", "torn.h5", "failed", cause="torn.h5: <b>expected</b> & more"),
    Record("stuck", "stuck.h5", "hung", cause="took longer"),
    Record("shot", "shot.h5", "crashed", cause="killed"),
]


def links(made: Elements) -> list[str]:
    return [value or "" for _, attributes in made.tags for name, value in attributes.items() if name == "href"]


def test_worst_first() -> None:
    order = ["shot", "stuck", "torn", "thin", "open", "near", "fine"]
    assert [record.part for record in worst_first(FLEET)] == order
    found = links(Elements(page(FLEET, "Fleet")))
    assert [unquote(link).partition("/")[0] for link in found] == order
    assert found[0] == "shot/part.json"
    assert found[3] == "thin/report.html"


def test_names_are_text() -> None:
    nasty = '"><script>alert(1)</script>'
    fleet = [part("a", [1.5], part_id=nasty + "\n\ud800"), Record("b", "b.h5", "failed", cause=nasty)]
    made = Elements(page(fleet, f"title {nasty}"))
    assert "script" not in {tag for tag, _ in made.tags}
    assert made.text.count("<script>alert(1)</script>") == 5  # title twice, part twice and cause
    assert fleet_files(fleet, nasty)["fleet.parquet"][:4] == b"PAR1"


@pytest.mark.parametrize(
    ("recording", "cause", "shown"),
    [
        ("/data/my parts/a.h5", "/data/my parts/a.h5: /profiles/x: expected 2", "a.h5: /profiles/x: expected 2"),
        ("a.h5", "/data/cell/handeye.json: $.pose: no matrix", "handeye.json: $.pose: no matrix"),
        ("C:\\parts\\a.h5", "C:\\parts\\a.h5: torn", "a.h5: torn"),
        ("parts/a.h5", "parts/a.h5: torn, see https://host/x/y.h5", "parts/a.h5: torn, see https://host/x/y.h5"),
    ],
)
def test_a_cause_tells_nothing_of_the_machine(recording: str, cause: str, shown: str) -> None:
    assert without_folders(cause, recording) == shown


def test_a_recording_that_is_copied_is_told() -> None:
    parts = [
        part(name, [1.5, 1.5], inputs=({"name": "recording", "path": name, "sha256": digest, "version": None},))
        for name, digest in ("a1", "b1", "c2")
    ]
    text = fleet_files(parts, "")["fleet.html"].decode()
    assert text.count("the same recording as") == 1
    assert "the same recording as a, byte for byte" in text


def test_a_part_number_that_two_recordings_have_is_told_by_the_page_and_the_terminal(capsys) -> None:
    parts = tuple(part(name, [1.5, 1.5], part_id=number) for name, number in (("a", "7"), ("b", "8"), ("c", "7")))
    assert fleet_files(parts, "")["fleet.html"].decode().count("has part number 7 as a has") == 1
    print_batch(Batch(parts, "out", ()))
    assert "3 parts, 3 passed (verdicts: 3 pass); 1 with the part number of another" in capsys.readouterr().out


def test_the_page_needs_nothing_else() -> None:
    parts = [part(f"p{i}", [1.5 + 0.01 * (i % 5), 1.4]) for i in range(30)]
    made = Elements(page(parts, "Fleet"))
    sources = [attributes["src"] for _, attributes in made.tags if "src" in attributes]
    assert len(sources) == 4
    assert all(source.startswith("data:image/svg+xml;base64,") for source in sources)
    assert not any(b"40.2000" in base64.b64decode(source.partition(",")[2]) for source in sources)  # all alike
    assert not {"script", "link", "iframe"} & {tag for tag, _ in made.tags}
    for count in (19, 20):  # Montgomery, 6.2
        assert ("Fewer than 20 parts: limits and indices are provisional" in page(parts[:count], "")) == (count < 20)


def test_every_part_and_section_is_a_row() -> None:
    table = pq.read_table(io.BytesIO(fleet_files(FLEET, "Fleet")["fleet.parquet"])).to_pydict()
    assert table["part"] == ["fine"] * 3 + ["near"] * 3 + ["open"] * 3 + ["thin"] * 3 + ["torn", "stuck", "shot"]
    assert table["order"] == [1] * 3 + [2] * 3 + [3] * 3 + [4] * 3 + [5, 6, 7]
    assert table["root_mm"][6:9] == [1.5, None, 1.2]
    assert table["section"][10:] == [2, 3, None, None, None]
    assert (table["root_lower_mm"][0], table["bevel_upper_deg"][0]) == (1.0, 41.0)
    assert table["cause"][-3] == "torn.h5: <b>expected</b> & more"


def test_a_trend_and_a_shift_stand_in_the_page() -> None:
    rng = np.random.default_rng(9)
    roots = 1.4 + 0.004 * np.arange(50) + 0.02 * rng.normal(size=50)
    made = page([part(f"p{i}", [root, 1.5]) for i, root in enumerate(roots)], "Fleet")
    assert "Nelson 2: nine in a row on one side of the mean" in Elements(made).text
    assert '<td class="trend">' in made


def test_a_pipeline_without_inspection_has_a_page_of_its_parts() -> None:
    fleet = [Record("a", "a.h5", "passed", files={"toolpath.json": "0", "run.json": "0"})]
    made = Elements(page(fleet, "Plan"))
    assert links(made) == ["a/run.json"]
    assert not [tag for tag, attributes in made.tags if "src" in attributes]


def test_what_cannot_be_measured_is_no_scrap() -> None:
    fleet = [part(f"p{i}", [1.5, 1.45]) for i in range(3)]
    fleet += [Record("x", "x.h5", "failed", cause="damaged"), Record("y", "y.h5", "hung", cause="too long")]
    made = cover(fleet)
    assert (made["measured"], made["unmeasured"]) == (3, [("x", "failed"), ("y", "hung")])
    assert sum(count for _, _, count in made["verdicts"]) == 3
    words = Elements(page(fleet, "Fleet")).text
    assert "3 of 5 parts" in words
    assert "(100.0 % of those measured)" in words
    assert "no statement on these parts" in words
