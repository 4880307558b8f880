"""Two J preparations make a U: a land between fillet and root face changes nothing of what is above it."""

from __future__ import annotations

import numpy as np
import pytest

from bench.odd_plates import j_shape
from bench.outside import FAR_MM
from tests.edge.test_odd_grooves import GAP, ROOT, THICK, groove, measured, mirrored

RADIUS_MM, FLANK_DEG = 4.0, 14.0


@pytest.mark.parametrize(("land_mm", "seed"), [(0.0, 10_000_010), (0.5, 10_000_011), (1.5, 10_000_013)])
def test_a_land_at_the_root_is_no_part_of_the_fillet(land_mm: float, seed: int) -> None:
    """Twelve of twelve were refused: a bent bevel, no two plates; in another simulator, a fillet off any circle."""
    above = j_shape(RADIUS_MM, FLANK_DEG, land_mm, THICK - ROOT)
    begin = ((-FAR_MM, 0.0), (-0.5 * GAP, 0.0), (-0.5 * GAP, ROOT))
    left = (*begin, *((u - 0.5 * GAP, v + ROOT) for u, v in above), (-FAR_MM, THICK))
    found = measured(groove(seed, (left, mirrored(left))))
    assert found.type == "U"
    for name, exact in {"root_radius_mm": RADIUS_MM, "depth_mm": THICK - ROOT, "bevel_left_deg": FLANK_DEG}.items():
        size = found.sizes[name]
        assert np.nanmax(np.abs(size.value - exact) / size.u) < 3.0, name
    assert np.nanmedian(found.sizes["root_radius_mm"].u) < 0.02
