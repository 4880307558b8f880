"""The history that the page, `run --store` and `batch --store` write: filters, charts, table."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.page.conftest import opened
from workbench.batch.part import Record
from workbench.page.jobs import GATE_PASSED, let_through
from workbench.page.records import alike, keep_batch, keep_run, summary
from workbench.page.store import Store

ROOT = Path(__file__).parents[2]
REQUIRED = {
    **{"root_nominal_mm": 1.5, "root_tolerance_mm": [-0.5, 0.5]},
    **{"bevel_nominal_deg": 40.0, "bevel_tolerance_deg": [-1.0, 1.0]},
}


def record(number: int, **changes: Any) -> Record:
    """A part of one section, its root face by 0.01 mm larger from part to part."""
    sizes = {"root_mm": 1.4 + 0.01 * number, "root_u_mm": 0.02, "bevel_deg": 40.0, "bevel_u_deg": 0.1}
    identity = {"part_id": f"P-{number}", "sensor": "LPS", "sensor_serial": str(number % 2), "robot": "KR"}
    told = {"identity": identity, "requirements": REQUIRED, "verdict": "pass", "part_id": f"P-{number}"}
    sections = ({"index": 1, "arc_length_mm": 1.0, **sizes, "verdict": "pass"},)
    return Record(f"part-{number}", f"part-{number}.h5", "passed", sections=sections, **told, **changes)


@pytest.fixture
def shop(tmp_path: Path) -> Path:
    keep_batch(str(tmp_path), "inspect_bevel", {}, [record(k) for k in range(6)], "out")
    return tmp_path


def test_a_batch_is_stored_once_and_charted(shop: Path) -> None:
    keep_batch(str(shop), "inspect_bevel", {}, [record(k) for k in range(7)], "out")
    with Store.of(shop) as store:
        runs = store.runs()
        assert [run.part for run in runs] == [f"P-{k}" for k in reversed(range(7))]
        assert store.known("sensor") == ["LPS 0", "LPS 1"]
        assert [run.part for run in store.runs({"sensor": "LPS 1", "part": "p-3"})] == ["P-3"]
        assert runs[0].sizes["root_mm"] == pytest.approx([1.46, 0.04])
    with opened(shop) as client:
        assert "Control charts" in client.ask("GET", "/")[1]
        charts = client.ask("GET", "/runs/charts?sensor=LPS+0")[1]
        assert "C<sub>pk</sub>" in charts
        assert "P-6" in charts
        assert "P-5" not in charts
        assert 'href="7/part.json"' in charts
        assert "P-6" in client.ask("GET", "/runs/7/part.json")[1]
        assert client.ask("GET", "/runs/charts?part=none")[0] == 400
        rows = pq.read_table(io.BytesIO(client.content("/runs/parts.parquet"))).to_pylist()
        assert [row["root_mm"] for row in rows] == pytest.approx([1.4 + 0.01 * k for k in range(7)])


def test_only_what_is_alike_shares_a_chart(shop: Path) -> None:
    """Other requirements are another chart, and a part that is judged again stays one part."""
    other = record(2, cause="again")
    keep_batch(str(shop), "inspect_bevel", {}, [other], "elsewhere")
    with Store.of(shop) as store:
        assert [run.part for run in alike(store.runs())] == ["P-0", "P-1", "P-3", "P-4", "P-5", "P-2"]
        store.add("inspect_groove", {}, state="done", record={"requirements": {}, "sections": [{"index": 1}]})
        assert len(alike(store.runs())) == 1


def test_what_the_gate_holds_back_is_no_pass() -> None:
    assert let_through({"verdict": "pass"}, False) == {"verdict": "undecided"}
    assert let_through({"verdict": "pass"}, True) == {"verdict": "pass"}
    assert let_through({"verdict": "fail"}, False) == {"verdict": "fail"}
    assert GATE_PASSED.match("gate: passed (all 9 sections within tolerance)")
    assert not GATE_PASSED.match("gate: loosened, a check was loosened (passed otherwise)")


def test_a_run_s_files_are_what_is_stored(tmp_path: Path) -> None:
    section = {"index": 1, "arc_length_mm": 2.0, "origin_mm": [0, 0, 0], "root_mm": 1.5, "root_u_mm": 0.1}
    tree = {
        "part": {"part_id": "P", "robot": "KR", "robot_serial": "7"},
        "requirements": REQUIRED,
        "sections": [{**section, "bevel_deg": None, "bevel_u_deg": None, "verdict": "undecided"}],
        "verdict": "undecided",
        "reason": "section 1 is open",
    }
    (tmp_path / "inspection.json").write_text(json.dumps(tree))
    (tmp_path / "next_scan.json").write_text(json.dumps({"sentence": "Scan from below."}))
    number = keep_run(str(tmp_path), "inspect_bevel", {"recording": "none.h5"}, 1, tmp_path)
    with Store.of(tmp_path) as store:
        found = store.run(number)
    assert (found.state, found.status, found.part, found.verdict) == ("done", 1, "P", "undecided")
    assert found.reason == "section 1 is open"
    assert found.record["todo"] == "Scan from below."
    assert found.record["cell"] == "KR 7"
    assert found.record["out"] == str(tmp_path)
    assert "origin_mm" not in found.record["sections"][0]
    calibrated = tmp_path / "calibrated"
    calibrated.mkdir()
    (calibrated / "handeye.json").write_bytes((ROOT / "data" / "calibration" / "handeye.json").read_bytes())
    assert summary(calibrated)["sizes"]["x_mm"][0] == pytest.approx(127.29, abs=0.01)
