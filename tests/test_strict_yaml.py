"""YAML means what the same JSON would, or is refused with line and column."""

import json
from pathlib import Path

import pytest

from workbench.errors import InputError
from workbench.strict_yaml import read_document

CELL = Path(__file__).parents[1] / "data" / "robot" / "cell.json"


def test_json_is_read_as_yaml(tmp_path: Path) -> None:
    """JSON is YAML: the same text under the other suffix gives the same tree, types included."""
    path = tmp_path / "cell.YAML"
    path.write_text(CELL.read_text())
    assert json.dumps(read_document(path)) == json.dumps(read_document(CELL))


def test_plain_types_are_those_of_yaml_1_2(tmp_path: Path) -> None:
    path = tmp_path / "types.yml"
    path.write_text(
        "on: yes\nnumbers: [1, -2.5, 1e5, .5, 010]\ntexts: [1:30, 2020-01-01, 0x10, 'true']\nbool: true\nnone:\n"
    )
    assert read_document(path) == {
        "on": "yes",
        "numbers": [1, -2.5, 1e5, 0.5, 10],
        "texts": ["1:30", "2020-01-01", "0x10", "true"],
        "bool": True,
        "none": None,
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\na: 2", "line 2, column 1: expected YAML: key 'a' stands twice"),
        ("a: &x [1]\nb: *x", "line 2, column 4: expected YAML: expected no aliases"),
        ("a: !!python/object:os.system 1", "line 1, column 4: expected YAML: expected no tag"),
        ("1: 2", "line 1, column 1: expected YAML: expected a text as key"),
        ("a: 1e999", "line 1, column 4: expected YAML: expected a finite number"),
        (f"a: {'9' * 5000}", "line 1, column 4: expected YAML: expected a finite number"),
        ("a: [1,\n  2", "line 2, column 4: expected YAML: expected ',' or ']'"),
        ("---\na: 1\n---\nb: 2", "line 3, column 1: expected YAML"),
        ("a: \x01", "character 3: expected YAML"),
        ("[" * 5000, "nested less deeply"),
        ("- 1", "$: expected an object"),
        ("", "$: expected an object"),
    ],
)
def test_what_is_not_strict_is_refused_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_document(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_not_utf_8_and_missing_files(tmp_path: Path) -> None:
    (tmp_path / "bytes.yaml").write_bytes(b"a: \xff")
    with pytest.raises(InputError, match="byte 3: expected YAML in UTF-8"):
        read_document(tmp_path / "bytes.yaml")
    with pytest.raises(InputError, match="no such file"):
        read_document(tmp_path / "none.yaml")
