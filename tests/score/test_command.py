"""`workbench score`: a submission by another program against a truth file."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    along = np.linspace(0.0, 90.0, 46)
    place = np.stack([along, 0 * along, 0 * along], axis=1).tolist()
    true = {"position_mm": place, "seen": [True] * 46, "root_mm": [1.5] * 46, "bevel_deg": [40.0] * 46}
    head = {"format": "edge-benchmark-truth", "version": 1, "benchmark": "0", "track": "milled", "set": "practice"}
    (tmp_path / "truth.json").write_text(json.dumps(head | {"recordings": {"one": true, "two": true}}))
    values = {"root_mm": 1.51, "root_u_mm": 0.01, "bevel_deg": 40.1, "bevel_u_deg": 0.1}
    sections = [{"origin_mm": place[k], **values} for k in range(2, 46, 5)]
    head = {"format": "edge-benchmark-submission", "version": 1, "method": "<mine> & yours", "track": "milled"}
    recordings = {"one": {"sections": sections, "seconds": 0.5}, "two": {"refused": "too dark"}}
    (tmp_path / "mine.json").write_text(json.dumps(head | {"recordings": recordings}))
    return tmp_path / "mine.json", tmp_path / "truth.json"


@pytest.mark.parametrize("by_folder", [False, True])
def test_the_card_is_printed_and_written(
    command: Any, files: tuple[Path, Path], by_folder: bool, tmp_path: Path
) -> None:
    submission, truth = files
    got = command("score", submission, truth.parent if by_folder else truth, "--out", tmp_path / "card")
    assert got.status == 0
    assert "root_mm: score 0.5196" in got.out  # half of 2 k u, half the price
    card = json.loads((tmp_path / "card" / "card.json").read_text())
    assert card["quantities"]["bevel_deg"]["coverage"] == 1.0
    assert card["seconds_median"] == 0.5
    page = (tmp_path / "card" / "card.html").read_text()
    assert "&lt;mine&gt; &amp; yours" in page
    assert "<mine>" not in page
    assert (tmp_path / "card" / "card.svg").read_bytes().startswith(b"<svg")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda s, _: s.pop("method"), "expected 'method'"),
        (lambda s, _: s.update(track="raw"), "expected 'milled'"),
        (lambda s, _: s.update(recordings={"other": {}}), "such as 'one'"),
        (lambda s, _: s["recordings"]["one"]["sections"][0].update(root_u_mm=-1.0), "root_u_mm"),
        (lambda _, t: t["recordings"]["one"]["seen"].pop(), "columns of one length"),
        (lambda _, t: t["recordings"]["one"].pop("seen"), "expected position_mm and seen"),
    ],
)
def test_what_cannot_be_scored_is_refused_in_one_line(
    command: Any, files: tuple[Path, Path], change: Any, complaint: str, tmp_path: Path
) -> None:
    documents = [json.loads(path.read_text()) for path in files]
    change(*documents)
    for path, document in zip(files, documents, strict=True):
        path.write_text(json.dumps(document))
    got = command("score", *files, "--out", tmp_path / "card")
    assert got.status == 2
    assert complaint in got.err
    assert got.err.count("\n") == 1
    assert not (tmp_path / "card").exists()
