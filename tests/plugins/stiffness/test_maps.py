"""Maps of dexterity and K_c against the closed form and the study's figures."""

from typing import Any

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.plugins.stiffness import maps
from workbench.robot import Cell


@pytest.fixture(scope="module")
def made(cell: Cell, stiffness: Any) -> Any:
    return maps(cell, stiffness, steps=15, directions=24)


def test_dexterity_is_the_closed_form(made: Any) -> None:
    """omega = a2 L3 |cos(q3 - 7.16 deg)| (wrist's reach) |sin q5|, in m."""
    q2, q3 = np.meshgrid(*made[0].at, indexing="ij")
    bend, length = np.arctan2(0.2, 1.5925), np.hypot(0.2, 1.5925)
    reach = np.abs(0.32 + 1.28 * np.sin(q2) + length * np.cos(q2 + q3 - bend))
    omega = 1.28 * length * np.abs(np.cos(q3 - bend)) * reach * np.sin(np.pi / 4)
    assert np.allclose(1 / made[0].inverse_dexterity, omega, atol=1e-12)


def test_kc_at_the_papers_postures(made: Any) -> None:
    """The study: 1/omega 0.372, 0.512, 0.353; f_p at most 0.005 and f_r at most 2e-5 rad."""
    values = made[0].marked_values
    assert np.allclose(values[:, 0], [0.372, 0.512, 0.353], atol=5e-4)
    assert 0.003 < values[:, 1].max() < 0.006
    assert 5e-6 < values[:, 2].max() < 3e-5


@pytest.mark.parametrize("change", [{"axes": (2, 2)}, {"ranges_deg": ((10, 10), (0, 5))}])
def test_empty_maps_are_refused(cell: Cell, stiffness: Any, change: Any) -> None:
    with pytest.raises(InputError):
        maps(cell, stiffness, **change)
