"""The document: strict JSON, its own form, and what `${name}` becomes."""

import gzip
from pathlib import Path

import pytest

from workbench import Pipeline
from workbench.errors import PipelineError

GOOD = b'{"version": 1, "stages": [{"stage": "a.b"}]}'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "line 1, column 1"),
        (b'{"version": 1,\n "stages": [}', "line 2, column 13"),
        (b'{"version": 1,\n "title": "caf\xe9"}', "line 2: is not UTF-8"),
        (b'{"version": 1, "version": 1, "stages": []}', "key 'version' occurs twice"),
        (b'{"version": 1, "stages": [{"stage": "a.b", "x": 1, "x": 2}]}', "stages[0]: key 'x' occurs twice"),
        (b'{"version": 1, "stages": [{"stage": "a.b", "x": NaN}]}', "stages[0].x: NaN is not JSON"),
        (b'{"version": 1, "stages": [{"stage": "a.b", "x": 1e999}]}', "stages[0].x: expected a finite number"),
        (b'{"version": 1, "inputs": {"a": ' + b"9" * 5000 + b"}}", "too many digits"),
        (b'{"version": 1E+99999999999999}', "version: expected a finite number"),
        (b'{"version": -Infinity}', "version: -Infinity is not JSON"),
        (b'{"version": "\xed\xa0\x80"}', "is not UTF-8"),
        ('{"version": 1}'.encode("utf-16"), "is not UTF-8"),
        (gzip.compress(b'{"version": 1}', mtime=0), "is not UTF-8"),
        (bytes(1000), "line 1, column 1"),
        (b"[" * 50 + b"]" * 50, "nested deeper than 32"),
        (b'{"a":' * 100_000 + b"1" + b"}" * 100_000, "nested deeper than 32"),
        (b"[" * 100_000 + b"]" * 100_000, "nested deeper than 32"),
        (b"[]", '{"version": 1, "stages": [...]}, got an array'),
        (b'{"version": 1, "stages": [],}', "column 29: a comma too many"),
        (b'{"version": 1, // mine\n "stages": []}', "column 16: JSON has no comments"),
        ("{\u201cversion\u201d: 1}".encode(), "column 2: JSON has straight double quotes"),
        (b'{"stages": [{"stage": "a.b"}]}', "key 'version' is missing"),
        (b'{"version": true, "stages": [{"stage": "a.b"}]}', "version: expected an integer, got true or false"),
        (b'{"version": 2, "stages": [{"stage": "a.b"}]}', "version: expected 1, got 2"),
        (b'{"version": 1, "stage": [], "stages": []}', "stage: unknown key; did you mean 'stages'?"),
        (b'{"version": 1, "stages": []}', "stages: expected at least one stage"),
        (b'{"version": 1, "stages": ["scan.read"]}', "stages[0]: expected an object, got a string"),
        (
            b'{"version": 1, "stages": [{"stge": "scan.read"}]}',
            "stages[0]: key 'stage' is missing; did you mean 'stge'?",
        ),
        (b'{"version": 1, "stages": [{"stage": 7}]}', "stages[0].stage: expected a string, got an integer"),
        (b'{"version": 1, "stages": [{"stage": "a.b", "id": "a b"}]}', "stages[0].id: expected letters"),
        (b'{"version": 1, "stages": [{"stage": "a.b", "from": {"x": [1]}}]}', "stages[0].from.x: expected the id"),
        (b'{"version": 1, "seed": -1, "stages": [{"stage": "a.b"}]}', "seed: expected"),
        (b'{"version": 1, "inputs": {"a-b": 1}, "stages": [{"stage": "a.b"}]}', "inputs: expected names"),
    ],
)
def test_bad_document_names_the_place(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "p.json"
    path.write_bytes(content)
    with pytest.raises(PipelineError) as caught:
        Pipeline.load(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.json", tmp_path, Path("nul\0"), tmp_path / ("x" * 300)):
        with pytest.raises(PipelineError, match="cannot be read"):
            Pipeline.load(path)
    with pytest.raises(PipelineError, match="larger than 4 MB"):
        Pipeline.load(Path("/dev/zero"))


def test_byte_order_mark_and_defaults(tmp_path: Path) -> None:
    path = tmp_path / "weld.json"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD)
    document = Pipeline.load(path).document
    assert (document.title, document.seed, document.inputs, document.base_dir) == ("weld", 0, {}, tmp_path)
