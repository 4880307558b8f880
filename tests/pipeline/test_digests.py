"""The digests of a run's inputs: right, in the order of the pipeline, and of files that stayed what they were."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from workbench.errors import InputError
from workbench.pipeline.digests import BLOCK_BYTES, digesting
from workbench.pipeline.wiring import InputRecord


@pytest.fixture
def records(tmp_path: Path) -> list[InputRecord]:
    """Files of no byte, of a few, and of several blocks."""
    contents = {"none": b"", "few": b"abc", "many": os.urandom(2 * BLOCK_BYTES + 5)}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    return [InputRecord(name, f"./{name}", tmp_path / name) for name in contents]


def test_digests_are_the_files(records: list[InputRecord]) -> None:
    with digesting([*records, records[1]]) as digests:
        found = digests.all()
    assert found == [
        (record.name, record.given, hashlib.sha256(record.path.read_bytes()).hexdigest()) for record in records
    ]


@pytest.mark.parametrize("how", ["written", "replaced", "removed"])
def test_a_file_that_changes_during_the_run_is_refused(records: list[InputRecord], how: str) -> None:
    path = records[1].path
    with digesting(records) as digests:
        digests.all()
        if how == "written":
            path.write_bytes(b"abcd")
        elif how == "replaced":
            records[0].path.with_name("other").write_bytes(b"abc")
            records[0].path.with_name("other").replace(path)
        else:
            path.unlink()
        with pytest.raises(InputError, match=r"^\./few: (changed while the pipeline ran|cannot be read any more)"):
            digests.all()


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match=r"^gone\.h5: cannot be read any more: No such file"),
        digesting([InputRecord("recording", "gone.h5", tmp_path / "gone.h5")]),
    ):
        pass
