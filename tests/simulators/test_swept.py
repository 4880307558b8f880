"""The swept simulator: its mesh against the exact section, what its pixels, losses and truth are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bench.simulators.swept import parse_swept_recipe, simulate_swept
from bench.simulators.swept.truth import SweptTruth
from tests.simulators.returns import in_sections
from workbench.artefacts import Recording
from workbench.errors import InputError

SPINES: dict[str, dict[str, Any]] = {
    "straight": {},
    "drifting": {"root_mm": {"start": 1.2, "end": 2}, "bevel_deg": {"start": 38, "end": 42, "amplitude": 0.5}},
    "twisted": {"twist_deg": {"start": 0, "end": 24}},
    "disc": {"spine": {"shape": "arc", "radius_mm": 60, "length_mm": 120}},
    "ring": {"spine": {"shape": "arc", "radius_mm": 45, "length_mm": 2 * math.pi * 45, "sense": "concave"}},
    "wavy": {"spine": {"shape": "wavy", "height_amplitude_mm": 3}},
    "helix": {"spine": {"shape": "arc", "rise_mm": 40, "radius_mm": 100}},
    "saddle": {"spine": {"shape": "saddle", "radius_mm": 100, "shell_radius_mm": 250, "start_deg": 20}},
    "waving": {"wave_mm": {"start": 0, "end": 0, "amplitude": 0.05, "wavelength_mm": 20}},
}


def simulated(part: dict[str, Any], **keys: Any) -> tuple[Recording, SweptTruth]:
    """Without noise unless `keys` say so, frames 1 mm apart, 300 columns."""
    length = part.get("spine", {}).get("length_mm", 120)
    document = {
        "simulator": "swept",
        "part": part,
        "passes": [{"way_mm": [2, length - 2], "aim_mm": [-3, 4]}],
        "scanner": {"columns": 300, "pitch_mm": 0.1, "noise": {"sd_mm": 0, "speckle": 0}},
        "robot": {"frame_pitch_mm": 1.0, "pose_rate_hz": 2000},
    }
    return simulate_swept(parse_swept_recipe(document | keys))


@pytest.mark.parametrize("name", SPINES)
def test_returns_lie_on_the_exact_section(name: str) -> None:
    recording, truth = simulated(SPINES[name])
    base, out, up = in_sections(recording, truth)
    root, bevel = truth.root_mm_at(base), np.radians(truth.bevel_deg_at(base))
    on_root = (up > 0.2) & (up < root - 0.2)
    over_bevel = out * np.cos(bevel) + (up - root) * np.sin(bevel)
    on_bevel = (up > root + 0.2) & (up < 7.5)
    assert on_root.sum() > 500
    assert on_bevel.sum() > 3000
    assert np.abs(out[on_root]).max() < 5e-4
    assert np.abs(over_bevel[on_bevel]).max() < 5e-4


def test_axes_are_right_handed_and_the_tangent_is_that_of_the_edge() -> None:
    for part in SPINES.values():
        _, truth = simulated(part)
        np.testing.assert_allclose(np.cross(truth.across, truth.normal), truth.tangent, atol=1e-9)
        chord = np.diff(truth.position_mm, axis=0)
        chord /= np.linalg.norm(chord, axis=1, keepdims=True)
        assert np.einsum("ij,ij->i", chord, truth.tangent[:-1]).min() > math.cos(math.radians(0.3))


def test_returns_end_where_the_virtual_edge_is() -> None:
    """Half of a footprint is seen just where its middle is: columns end without a bias, over many phases."""
    recipe = {"columns": 300, "pitch_mm": 0.1, "noise": {"sd_mm": 0, "speckle": 0}, "mixed_share": 0}
    passes = [{"way_mm": [2, 118], "aim_mm": [-3, 4], "skew_mm": [-1.5, 1.5]}]
    recording, truth = simulated({}, scanner=recipe, passes=passes, robot={"frame_pitch_mm": 0.2, "pose_rate_hz": 2000})
    _, out, up = in_sections(recording, truth)
    frame = np.nonzero(np.isfinite(recording.z_mm))[0]
    low = np.full(len(recording.z_mm), np.inf)
    on_root = (np.abs(out) < 0.08) & (up < 1.4)
    np.minimum.at(low, frame[on_root], up[on_root])
    step = 0.1 / math.cos(math.radians(40))
    assert low.min() > -0.35 * step  # the mean place of a half filled footprint lies off its column's middle
    assert abs(float(np.mean(low)) - step / 2) < 0.06 * step


def test_a_rounding_takes_away_and_a_burr_adds_but_the_truth_stays() -> None:
    sharp = simulated({})[1]
    rounded, truth = simulated({"lower_radius_mm": 0.4})
    _, out, up = in_sections(rounded, truth)
    assert np.array_equal(truth.root_mm, sharp.root_mm)
    np.testing.assert_allclose(truth.position_mm, sharp.position_mm, atol=1e-12)
    bent = (up > 0.0) & (up < 0.3) & (np.abs(out) < 0.4)
    assert -0.15 < out[bent].min() < -0.01  # what the columns of 0.1 mm see of it
    burr = {"edge": "lower", "direction": "in_plane", "from_mm": 20, "to_mm": 60, "height_mm": 0.3, "ragged": 0.0}
    recording, truth = simulated({"burrs": [burr]})
    base, out, up = in_sections(recording, truth)
    along = truth.arc_length_mm_at(base)
    below = (np.abs(out) < 0.05) & (up < -0.15)
    assert below.sum() > 20
    assert along[below].min() > 19
    assert along[below].max() < 61


def test_refusals_name_the_key() -> None:
    with pytest.raises(InputError, match=r"part\.twist: .*did you mean 'twist_deg'"):
        parse_swept_recipe({"simulator": "swept", "part": {"twist": 3}, "passes": [{"way_mm": [0, 1]}]})
    with pytest.raises(InputError, match="rounding is wider"):
        simulated({"lower_radius_mm": 3.0})
