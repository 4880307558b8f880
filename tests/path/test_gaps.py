"""What repeats from part to part, in a stretch of the edge that nothing shows."""

import numpy as np
import pytest

from workbench.path.displacement import Prior, estimate
from workbench.units import Float


@pytest.mark.parametrize("wave_mm", [60.0, 75.0, 90.0])
@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0])
def test_where_nothing_was_measured_what_repeats_is_as_unsure_as_it_is_wrong(wave_mm: float, turn: float) -> None:
    def error_mm(s: Float) -> Float:
        return 0.3 + 0.1 * np.sin(2.0 * np.pi * s / wave_mm + turn)

    seen, gap = np.r_[0.0:60.0:2.0, 140.0:200.0:2.0], np.arange(76.0, 125.0, 4.0)
    noise = np.random.default_rng(1).normal(0.0, 0.01, seen.size)
    axes = np.tile([1.0, 0.0, 0.0], (seen.size, 1))
    prior = Prior(largest=0.5, varying=0.3, unrepeated=0.005, unrepeated_length_mm=10.0)
    found = estimate(seen, error_mm(seen) + noise, np.full(seen.size, 0.01), axes, gap, axes[: gap.size], prior)
    assert np.sqrt(np.mean(((found.value - error_mm(gap)) / found.u) ** 2)) < 3.0
    assert found.u.max() > 0.03
