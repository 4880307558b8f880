"""Programs of others read what is written; those that are not on this machine are skipped (docs/stability.md)."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from workbench.cli import main
from workbench.export import inspection as export_inspection

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "data" / "synthetic" / "milled_edge.h5"


@pytest.mark.parametrize("name", ["pandas", "polars"])
def test_tables_are_read(name: str, inspected, provenance) -> None:
    library = pytest.importorskip(name, reason=f"{name} is not installed")
    made = {kind: export_inspection(inspected.inspection, provenance, format=kind) for kind in ("parquet", "csv")}
    told = [one.root_mm for one in inspected.inspection.sections]
    for kind, document in made.items():
        table = getattr(library, f"read_{kind}")(io.BytesIO(document.content))
        assert table["root_mm"].to_list() == pytest.approx(told, nan_ok=True)
        assert table["verdict"].to_list() == [one.verdict for one in inspected.inspection.sections]


@pytest.mark.parametrize("result", ["inspection", "toolpath", "handeye"])
def test_schemas_are_schemas(result: str, capsys: pytest.CaptureFixture[str]) -> None:
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    assert main(["schema", result]) == 0
    schema = json.loads(capsys.readouterr().out)
    jsonschema.validators.validator_for(schema).check_schema(schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"format": "another"}, schema)


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="h5dump is not installed")
def test_h5dump_reads_a_recording() -> None:
    command = ["h5dump", "-H", str(RECORDING)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert 'DATASET "quaternion_wxyz"' in said
