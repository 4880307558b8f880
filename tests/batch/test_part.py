"""part.json: read back as written; what nobody wrote is no record."""

import json

import pytest

from workbench.batch.part import Record

RECORD = Record(
    "a",
    "a.h5",
    "rejected",
    cause="fail",
    sections=({"index": 1, "root_mm": None},),
    requirements={"root_nominal_mm": 1.5},
    seconds=0.25,
    pipeline="p",
    versions="v",
    inputs=({"name": "recording", "path": "a.h5", "sha256": "0"},),
    files={"run.json": "1"},
)


def test_it_is_read_as_written() -> None:
    assert Record.read(RECORD.content()) == RECORD


@pytest.mark.parametrize(
    "change",
    [
        {"format": "other"},
        {"version": 2},
        {"outcome": "odd"},
        {"files": {"../up": "1"}},
        {"files": 3},
        {"sections": [3]},
        {"inputs": None},
        {"seconds": -1.0},
    ],
)
def test_what_is_no_record(change: dict[str, object]) -> None:
    assert Record.read(json.dumps(json.loads(RECORD.content()) | change).encode()) is None


@pytest.mark.parametrize("content", [None, b"", b"[", b"[]", b"3", b"{}", b"\xff", b"[" * 100_000])
def test_what_is_not_even_json(content: bytes | None) -> None:
    assert Record.read(content) is None
