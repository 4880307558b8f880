"""Seven corners of a groove: written, read again, and refused where they are none."""

import numpy as np
import pytest

from bench.groove.drawn import random_prism_recipe
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.errors import InputError
from workbench.export import corners
from workbench.export.corners import read_corners, recognised, written
from workbench.scan import fuse
from workbench.synthetic.prism_scan import simulate_prism


def test_what_is_written_is_read() -> None:
    place = np.random.default_rng(3).uniform(-100.0, 100.0, (5, 7, 3))
    text = written(place).decode()
    assert recognised(text)
    assert np.allclose(read_corners(text, "t").corners_mm, place, atol=2e-5)


def test_the_torch_stands_behind_its_row() -> None:
    rows = written(np.zeros((2, 7, 3))).decode().splitlines()
    found = read_corners("\n".join([rows[0] + ",", "Torchpos:-0.026,-0.176", rows[1], ""]), "t")
    assert found.torch_mm[0].tolist() == [-26.0, -176.0]
    assert np.isnan(found.torch_mm[1]).all()


@pytest.mark.parametrize("text", ["", "1,2,3\n4,5,6\n", "Torchpos:1,2\n", "0," * 20 + "1e400\n", "0," * 20 + "nan\n"])
def test_what_is_none_is_one_line(text: str) -> None:
    with pytest.raises(InputError, match="t: "):
        read_corners(text.replace("1e400", "1e300"), "t: ")


def test_a_v_groove_by_seven_corners() -> None:
    recording, truth = simulate_prism(random_prism_recipe("V", 81))
    groove = segment_groove(denoise(fuse(recording)))
    found = read_corners(corners(groove).content.decode(), "corners.csv").corners_mm
    width = np.abs(found[:, 6, 0] - found[:, 0, 0])
    assert np.median(width) == pytest.approx(np.median(truth.sizes.width_mm), abs=0.05)
    gap = np.abs(found[:, 5, 0] - found[:, 1, 0])
    assert np.median(gap) == pytest.approx(np.median(truth.sizes.gap_mm), abs=0.1)
    assert (np.diff(found[:, :, 0], axis=1) < 0).all()


def test_a_groove_with_one_root_has_no_seven_corners() -> None:
    recording, _ = simulate_prism(random_prism_recipe("HV", 82))
    with pytest.raises(InputError, match="seven corners need both plates' roots"):
        corners(segment_groove(denoise(fuse(recording))))
