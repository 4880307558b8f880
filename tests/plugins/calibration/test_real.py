"""A real recording, where it is at hand: what comes out is told, not hidden."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from workbench.api import InputError
from workbench.plugins.calibration import circles, hand_eye
from workbench.scan import read

REAL = Path(__file__).parents[3].parent / "shared" / "data" / "sphere_r12.7.h5"
pytestmark = pytest.mark.skipif(not REAL.exists(), reason="the real recording is not here")


def test_sphere_of_25_mm() -> None:
    rec = read(recording=REAL)
    profiles = circles(rec)
    assert (len(profiles.frame), profiles.rejected, profiles.sense) == (10, (), 1)
    assert 0.08 < profiles.noise_mm < 0.2
    with pytest.raises(InputError, match=r"109 by 48 mm, allowed 0.75 mm .* pose errors of 0.26 mm an axis"):
        hand_eye(profiles, rec)
    found = hand_eye(profiles, rec, max_u_mm=2)[1]
    assert found.frames_used == tuple(range(10))
    assert found.residual_rms_mm < 0.3
    assert 0.5 < found.volume_u_mm < 1.0
    np.testing.assert_allclose(
        found.hand_eye.flange_from_profiler[:3, 3], [79.5, -11.4, 263.8], atol=2.5
    )  # point fit's
    said = " ".join(found.warnings)
    assert "misfit that repeatability cannot explain" in said
    assert "the profiler's z is 8.2 +- 1.1 % too long" in said
    assert "points scatter by 0.12" in said
