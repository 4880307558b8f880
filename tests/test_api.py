"""The door for plug-ins, and one set of numbers by command line, pipeline and plain functions."""

import json
from pathlib import Path
from typing import Any

import pytest

import workbench
from tests.made import files_of
from workbench import Pipeline, api, artefacts
from workbench.artefacts import Inspection

ROOT = Path(__file__).parents[1]
RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"


def test_api_offers_what_it_names() -> None:
    assert len(set(api.__all__)) == len(api.__all__)
    assert all(hasattr(api, name) for name in api.__all__)
    made_here = [
        name
        for name, kind in vars(artefacts).items()
        if str(getattr(kind, "__module__", "")).startswith(artefacts.__name__)
    ]
    assert set(made_here) <= set(api.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Piepline'"):
        _ = workbench.Piepline


@pytest.fixture(scope="module")
def pipeline() -> dict[str, Any]:
    """The shipped inspection without its page."""
    document = json.loads((ROOT / "pipelines" / "inspect_bevel.json").read_text())
    document["stages"] = [entry for entry in document["stages"] if not entry["stage"].startswith("report.")]
    document["inputs"]["recording"] = str(RECORDING)
    return document


def test_command_line_pipeline_and_functions_give_the_same_bytes(pipeline: Any, command: Any, tmp_path: Path) -> None:
    from workbench.cloud import denoise
    from workbench.edge import segment
    from workbench.inspect import sections
    from workbench.scan import fuse, read

    (tmp_path / "p.json").write_text(json.dumps(pipeline))
    got = command("run", tmp_path / "p.json", "--out", tmp_path / "out", "--input", "sections=5")
    results = Pipeline(pipeline).run(inputs={"sections": 5})
    by_hand = sections(segment(denoise(fuse(read(recording=RECORDING)))), sections=5)
    assert got.status == 0
    written = (tmp_path / "out" / "inspection.json").read_bytes()
    assert written == files_of(results.last(Inspection))["inspection.json"]
    assert written == files_of(by_hand)["inspection.json"]
    assert len(json.loads(written)["sections"]) == 5
