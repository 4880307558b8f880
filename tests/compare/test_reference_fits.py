"""`compare.reference_fits`: data sets and answers as files."""

import json
from pathlib import Path

import numpy as np
import pytest

from workbench.compare import reference_fits
from workbench.errors import InputError

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_shipped_pair_passes(shape: str) -> None:
    document, chapter = reference_fits(points=[DATA / f"{shape}.ds"], answers=[DATA / f"{shape}.fit"], shape=shape)
    (row,) = json.loads(document.content)["fits"]
    assert row["relative_error"] < 1e-9
    assert row["rms_mm"] > 1e-3
    assert f"1 of 1 {shape} fits" in chapter.summary


def test_a_wrong_answer_does_not_pass(tmp_path: Path) -> None:
    """A radius taken for the diameter, a direction that is off by 1e-6."""
    values = np.loadtxt(DATA / "sphere.fit")
    np.savetxt(tmp_path / "wrong.fit", np.r_[values[:3], values[3] / 2])
    document, chapter = reference_fits(points=[DATA / "sphere.ds"], answers=[tmp_path / "wrong.fit"], shape="sphere")
    assert json.loads(document.content)["fits"][0]["radius_error_mm"] == pytest.approx(values[3] / 4)
    assert "0 of 1" in chapter.summary
    values = np.loadtxt(DATA / "cylinder.fit")
    values[3:6] += np.cross(values[3:6], [1e-6, 0.0, 0.0])
    np.savetxt(tmp_path / "turned.fit", values)
    document, _ = reference_fits(points=[DATA / "cylinder.ds"], answers=[tmp_path / "turned.fit"], shape="cylinder")
    assert 1e-8 < json.loads(document.content)["fits"][0]["direction_error"] < 2e-6


@pytest.mark.parametrize(
    ("points", "answer", "words"),
    [
        ("1 2 3\n4 5\n", "1 2 3 4", "line 2: expected three numbers, found 2"),
        ("1 2 x\n", "1 2 3 4", "line 1: expected finite numbers, found 'x'"),
        ("# none\n", "1 2 3 4", "expected points, found none"),
        ("0 0 0\n1 0 0\n2 0 0\n3 0 0\n", "1 2 3 4", "one line"),
        (
            "0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 2 2\n",
            "1 2 3",
            "expected 4 numbers for a sphere, centre and diameter, found 3",
        ),
        ("0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 2 2\n", "1 2 3 -4", "diameter above 0"),
    ],
)
def test_unusable_files_are_refused(points: str, answer: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.ds").write_text(points)
    (tmp_path / "a.fit").write_text(answer)
    with pytest.raises(InputError) as caught:
        reference_fits(points=[tmp_path / "a.ds"], answers=[tmp_path / "a.fit"], shape="sphere")
    assert words in str(caught.value)


def test_counts_must_agree() -> None:
    with pytest.raises(InputError, match="expected 1 files"):
        reference_fits(points=[DATA / "sphere.ds"], answers=[DATA / "sphere.fit"] * 2, shape="sphere")
