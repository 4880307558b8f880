"""Seven corners of a groove: rows in metres are read, and refused where they are none."""

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.look.seven_corners import read_corners, recognised
from workbench.units import Float


def written(corners_mm: Float) -> str:
    """Rows of corners (n, 7, 3) in mm as a tracker writes them, in metres."""
    return "\r\n".join(",".join(f"{1e-3 * value:.8f}" for value in row.ravel()) for row in corners_mm) + "\r\n"


def test_what_is_written_is_read() -> None:
    place = np.random.default_rng(3).uniform(-100.0, 100.0, (5, 7, 3))
    text = written(place)
    assert recognised(text)
    assert np.allclose(read_corners(text, "t").corners_mm, place, atol=2e-5)


def test_the_torch_stands_behind_its_row() -> None:
    rows = written(np.zeros((2, 7, 3))).splitlines()
    found = read_corners("\n".join([rows[0] + ",", "Torchpos:-0.026,-0.176", rows[1], ""]), "t")
    assert found.torch_mm[0].tolist() == [-26.0, -176.0]
    assert np.isnan(found.torch_mm[1]).all()


@pytest.mark.parametrize("text", ["", "1,2,3\n4,5,6\n", "Torchpos:1,2\n", "0," * 20 + "1e400\n", "0," * 20 + "nan\n"])
def test_what_is_none_is_one_line(text: str) -> None:
    with pytest.raises(InputError, match="t: "):
        read_corners(text.replace("1e400", "1e300"), "t: ")
