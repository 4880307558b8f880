"""Names of parts: safe as a folder's, one a part, in the order of production."""

from pathlib import Path

import pytest

from workbench.batch.run import parts, safe_name
from workbench.errors import InputError


@pytest.mark.parametrize(
    ("recording", "name"),
    [
        ("parts/part-7.h5", "part-7"),
        ("file:///parts/part-7.h5", "part-7"),
        ("s3://bucket/july/part-7.h5", "part-7"),
        ("a b<script>.h5", "a_b_script_"),
        ("Blech-ä.h5", "Blech-ä"),
        ("Blech-a\u0308.h5", "Blech-ä"),  # the same letter, composed
        (".hidden.h5", "hidden"),
        ("..\\..\\up.h5", "_.._up"),
        ("a\nb.h5", "a_b"),
        ("x" * 300 + ".h5", "x" * 100),
        ("scan.txt", "scan.txt"),
    ],
)
def test_a_name_is_a_visible_folder_and_nothing_else(recording: str, name: str) -> None:
    assert safe_name(recording) == name
    assert Path("out", name).resolve().parent == Path("out").resolve()


@pytest.mark.parametrize("recording", ["...h5", "fleet.html", "FLEET.parquet.h5", "superseded", "s3://bucket/..", "/"])
def test_what_cannot_be_a_folder_is_refused(recording: str) -> None:
    with pytest.raises(InputError, match="a folder can be called after"):
        safe_name(recording)


def test_the_same_folder_for_two_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.h5").touch()
    for pair in (["x/p.h5", "y/p.h5"], ["P.h5", "p.h5"], ["a b.h5", "a_b.h5"], ["s3://b/p.h5", "p.h5"]):
        with pytest.raises(InputError, match=f"^{pair[1]}.*as those of {pair[0]}"):
            parts(pair)
    for pair in (["p.h5", "./p.h5"], ["s3://b/p.h5"] * 2, [str(tmp_path / "a.h5"), f"file://{tmp_path}/a.h5"]):
        with pytest.raises(InputError, match="is given twice"):
            parts(pair)


def test_a_folder_stands_for_its_recordings_by_number(tmp_path: Path) -> None:
    for name in ("part-10.h5", "part-2.h5", "part-1.h5", "notes.txt"):
        (tmp_path / name).touch()
    assert [part.name for part in parts([str(tmp_path)])] == ["part-1", "part-2", "part-10"]
    assert [part.name for part in parts(["z.h5", "a.h5"])] == ["z", "a"]  # as given
    assert [part.name for part in parts([str(tmp_path / "part-*.h5")])] == ["part-1", "part-2", "part-10"]
    (tmp_path / "empty").mkdir()
    for nothing in ([], [str(tmp_path / "empty")], [str(tmp_path / "p?.h5")]):
        with pytest.raises(InputError, match="expected"):
            parts(nothing)
