"""Of two corners of about the bevel angle, the one whose root face is square to the upper surface is the bevel's."""

from __future__ import annotations

import numpy as np

from bench.score.measure import alone
from bench.score.outsider import below

MOST = 3.0  # times u, in the worst section


def test_a_rounding_is_not_read_as_the_root_face() -> None:
    """A rounding of 0.29 mm beside a root face of 0.88 mm, of which 0.6 mm are flat: refused as a bowed face before."""
    found = alone(below(18_400_006))
    assert not found.refused
    for one in found.found.values():
        assert np.abs(one.error / one.u).max() < MOST
