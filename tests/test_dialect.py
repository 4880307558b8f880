"""What every dialect rests on: remarks that no controller mistakes, feeds that it can take."""

import numpy as np
import pytest

from workbench.dialect import rounded_feeds


def test_feeds_have_three_digits() -> None:
    feeds = rounded_feeds(np.array([1.0, 1.23456, 19.996, 0.012345, 123.45, 0.3]))
    assert feeds.tolist() == pytest.approx([1.0, 1.23, 20.0, 0.0123, 123.0, 0.3], rel=1e-12)
