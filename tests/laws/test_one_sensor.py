"""A recording of which a part is of another sensor, or of no robot, is refused, and told by what that part is."""

from __future__ import annotations

from functools import cache
from itertools import cycle

import numpy as np
import pytest

from bench.confidently_wrong.kinds import frozen_stream, later
from bench.recordings import with_grid
from tests.laws.dozen import DOZEN
from workbench.artefacts import Recording
from workbench.checks import judge_recording
from workbench.errors import InputError
from workbench.scan import fuse, read

RNG = np.random.default_rng(11_140_000)
SHIPPED = ["milled_edge", "milled_arc", "milled_two_pass", "raw_edge", "raw_arc", "raw_wavy"]
ALL = [*DOZEN, *SHIPPED]


@cache
def sound(name: str) -> Recording:
    return DOZEN[name]().recording if name in DOZEN else read(recording=f"data/synthetic/{name}.h5")


@pytest.mark.parametrize(("name", "factor"), zip(ALL[::2], cycle((0.99, 1.04)), strict=False))
def test_half_a_recording_of_another_lateral_scale_is_refused_by_its_frame(name: str, factor: float) -> None:
    """Answered, 13 to 40 u off, before."""
    scan = sound(name)
    told = rf"x is scaled by \{100 * (factor - 1):+.1f} % from frame {len(scan.time_s) // 2} on"
    with pytest.raises(InputError, match=told):
        fuse(later(lambda x, z: (factor * x, z))(scan, RNG))


@pytest.mark.parametrize(("name", "is_mirrored"), zip(ALL[1::2], cycle((True, False)), strict=False))
def test_half_a_recording_mirrored_or_with_its_columns_reversed_is_refused(name: str, is_mirrored: bool) -> None:
    """Answered, 150 to 250 u off of a raw edge, before."""
    scan = sound(name)
    told = f"mirrored, or columns are reversed, from frame {len(scan.time_s) // 2} on"
    with pytest.raises(InputError, match=told) as refused:
        fuse(later(lambda x, z: (-x, z) if is_mirrored else (x[:, ::-1], z[:, ::-1]))(scan, RNG))
    assert len(str(refused.value)) < 200 + len(scan.source)


@pytest.mark.parametrize("name", ["milled_edge", "milled_arc", "raw_edge", "raw_arc", "raw_wavy"])
def test_ranges_in_reverse_order_are_seen_by_the_profiles_alone(name: str) -> None:
    """Columns keep their lateral places."""
    with pytest.raises(InputError, match="profiles are mirrored"):
        fuse(later(lambda x, z: (x, z[:, ::-1]))(sound(name), RNG))


@pytest.mark.parametrize("name", ["straight", "twisted", "camera", "raw", "groove"])
def test_a_sensor_may_resample_jitter_lose_columns_and_follow_the_part(name: str) -> None:
    scan = sound(name)
    shape = scan.x_mm.shape
    own = np.linspace(0.97, 1.03, shape[0])[RNG.permutation(shape[0]), None]
    window = np.arange(shape[1] - 48) + RNG.choice([0, 16, 48], shape[0])[:, None]
    followed = (np.take_along_axis(grid, window, axis=1) for grid in (scan.x_mm, scan.z_mm))
    for x_mm, z_mm in (
        (scan.x_mm + RNG.normal(0.0, 0.01, shape), scan.z_mm),
        (np.where(RNG.random(shape) < 0.3, np.nan, scan.x_mm), scan.z_mm),
        (own * scan.x_mm, scan.z_mm),
        followed,
    ):
        spoilt = with_grid(scan, x_mm, z_mm)
        found = {check.name: check for check in judge_recording(spoilt)}
        assert found["one_sensor"].passed
        assert found["mirrored_frames"].passed


@pytest.mark.parametrize(
    ("name", "share"), [("milled_arc", 0.3), ("raw_arc", 0.5), ("twisted", 0.3), ("raw, camera", 0.5)]
)
def test_an_orientation_that_hangs_in_a_part_of_a_pass_is_refused(name: str, share: float) -> None:
    """Answered, 9 u off, before."""
    with pytest.raises(InputError, match="and the next one jumps: a frozen stream"):
        fuse(frozen_stream(share, turns=True)(sound(name), RNG))


@pytest.mark.parametrize("step_mm", [0.001, 0.005])
def test_a_fan_of_rays_may_round_x_and_stand_off_anew(step_mm: float) -> None:
    """Refused as scaled by 2 %: from frame to frame ranges change by no more than x is rounded to."""
    scan = sound("milled_two_pass")
    z = scan.z_mm + 4.0 * (scan.pass_index > scan.pass_index[0])[:, None]
    x = np.round(scan.x_mm * z / np.nanmedian(z) / step_mm) * step_mm
    found = {check.name: check for check in judge_recording(with_grid(scan, x, z))}
    assert found["one_sensor"].passed
