"""Milling force against the averaged formulas of a slot, symmetry, runout, and the stage on a path."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from workbench.api import (
    Cutter,
    Engagement,
    Layer,
    LayerEngagement,
    Toolpath,
    quaternion_from_rotation,
    rotation_from_vector,
)
from workbench.errors import InputError
from workbench.plugins.stiffness import force
from workbench.plugins.stiffness.force_stage import PUBLISHED, STEPS, CuttingCoefficients, Teeth, edges_in_cut
from workbench.result_files import result_schema

C = PUBLISHED["al7075_t6"]
CUTTER = Cutter()


def one(
    radial: float, axial: float, feed: float = 0.05, c: CuttingCoefficients = C, steps: int = STEPS, **teeth: float
) -> Any:
    return with_torque(radial, axial, feed, c, steps, **teeth)[:, :3]


def with_torque(
    radial: float, axial: float, feed: float = 0.05, c: CuttingCoefficients = C, steps: int = STEPS, **teeth: float
) -> Any:
    met = np.array([feed]), np.array([radial]), np.array([axial])
    return edges_in_cut(CUTTER, *met, Teeth(**teeth), steps).forces(c)[0]


@pytest.mark.parametrize("name", [*PUBLISHED][:2])
@pytest.mark.parametrize(("radial_mm", "helix_deg"), [(10.0, 0.0), (10.0, 30.0), (1.0, 0.0), (1.0, 30.0)])
def test_mean_of_a_slot_and_of_a_partial_cut(radial_mm: float, helix_deg: float, name: str) -> None:
    """Averages over 0 to p, integrated by hand (Altintas); the helix changes no mean."""
    of, n, a, f = PUBLISHED[name], CUTTER.flutes, 3.0, 0.04
    p = np.arccos(1 - radial_mm / 5.0)
    found = one(radial_mm, a, f, of, helix=np.radians(helix_deg), steps=7200).mean(axis=0)
    sin2, sincos, sine, cosine = p / 2 - np.sin(2 * p) / 4, np.sin(p) ** 2 / 2, 1 - np.cos(p), np.sin(p)
    x = of.ktc_n_mm2 * f * sin2 + of.kte_n_mm * sine - of.krc_n_mm2 * f * sincos - of.kre_n_mm * cosine
    y = -of.ktc_n_mm2 * f * sincos - of.kte_n_mm * cosine - of.krc_n_mm2 * f * sin2 - of.kre_n_mm * sine
    z = of.kac_n_mm2 * f * sine + of.kae_n_mm * p
    assert np.allclose(found, n * a / (2 * np.pi) * np.array([x, y, z]), rtol=3e-3)


@pytest.mark.parametrize("helix_deg", [0.0, 30.0])
def test_work_of_the_spindle_is_that_of_the_chip(helix_deg: float) -> None:
    """Mean power without edge forces is K_tc times the volume removed in a time, whatever the cut and the helix."""
    chip, rpm, f = replace(C, kte_n_mm=0.0, krc_n_mm2=0.0, kre_n_mm=0.0), 6000.0, 0.05
    for radial, axial in ((0.5, 2.0), (4.0, 1.0), (10.0, 0.5)):
        torque_nm = with_torque(radial, axial, f, chip, 7200, helix=np.radians(helix_deg))[:, 3].mean()
        volume_mm3_s = radial * axial * f * CUTTER.flutes * rpm / 60
        assert torque_nm * rpm * np.pi / 30 == pytest.approx(C.ktc_n_mm2 * volume_mm3_s / 1000, rel=2e-3)


def test_papers_case_peaks_at_40_n() -> None:
    """6000 rpm, 1 mm/s, 1 mm, 4 flutes, 10 mm: 2.5 micrometres a tooth; the edge makes 90 to 99 % of some 40 N."""
    peak = np.linalg.norm(one(1.0, 1.0, 0.0025, helix=np.radians(30)), axis=1).max()
    edge = CuttingCoefficients(0, 0, 0, C.kte_n_mm, C.kre_n_mm, C.kae_n_mm)
    of_edge = np.linalg.norm(one(1.0, 1.0, 0.0025, c=edge, helix=np.radians(30)), axis=1).max()
    assert 35 < peak < 45
    assert 0.90 < of_edge / peak < 0.99


def test_runout_leaves_the_chip_to_fewer_teeth() -> None:
    """No edge forces: runout beyond the feed leaves one tooth, which takes the whole chip; the mean stays."""
    chip = CuttingCoefficients(700, 200, 100, 0, 0, 0)
    even = one(1.0, 1.0, 0.0025, c=chip)
    uneven = one(1.0, 1.0, 0.0025, c=chip, runout_mm=0.05)
    assert np.allclose(uneven.mean(axis=0), even.mean(axis=0), rtol=1e-3)
    assert np.isclose(np.linalg.norm(uneven, axis=1).max(), 4 * np.linalg.norm(even, axis=1).max(), rtol=0.02)
    cutting = [np.count_nonzero(np.linalg.norm(one_, axis=1) > 1e-9) for one_ in (even, uneven)]
    assert np.isclose(cutting[0] / cutting[1], 4, rtol=0.05)


@pytest.fixture
def path() -> Toolpath:
    k = 5
    turn = rotation_from_vector(np.array([0.3, -0.4, 0.2]))
    layer = Layer(
        index=1,
        height_mm=0.0,
        arc_length_mm=np.arange(k) - 1.0,
        position_mm=np.zeros((k, 3)),
        quaternion_wxyz=np.tile(quaternion_from_rotation(turn), (k, 1)),
        feed_mm_s=np.ones(k),
        cutting=np.arange(k) > 0,
        measured=np.ones(k, bool),
        width_mm=np.where(np.arange(k) > 0, 4.0, 0.0),
    )
    return Toolpath(
        cutter=CUTTER,
        layers=(layer,),
        travels=(),
        root_mm=1.5,
        bevel_deg=40,
        depth_of_cut_mm=1.0,
        v_slow_mm_s=1.0,
        edge_length_mm=3.0,
    )


def test_stage_on_a_path(path: Toolpath) -> None:
    """Without engagement: the path's depth and the face's width; in the air nothing."""
    found, document = force(path)
    layer = found.layers[0]
    expected = one(1.0, 4.0, 0.0025, helix=np.radians(30))
    assert np.allclose(layer.mean_n[1:], expected.mean(axis=0))
    assert (layer.mean_n[0] == 0).all()
    assert np.allclose(np.linalg.norm(layer.peak_n[1:], axis=1), np.linalg.norm(expected, axis=1).max())
    assert document.name == "milling_force.json"
    assert json.loads(document.content)["frame"] == "point"
    assert "x into the material" in result_schema(document.name)["properties"]["frame"]["description"]


def test_engagement_counts(path: Toolpath) -> None:
    met = LayerEngagement(
        1, path.layers[0].arc_length_mm, np.array([0, 0.5, 1, 1, 0.0]), np.array([0, 2.0, 4, 1, 0]), np.zeros(5)
    )
    layer = force(path, Engagement((met,)))[0].layers[0]
    assert np.allclose(layer.mean_n[1], one(0.5, 2.0, 0.0025, helix=np.radians(30)).mean(axis=0))
    assert (layer.mean_n[4] == 0).all()
    short = LayerEngagement(1, *(np.zeros(3),) * 4)
    with pytest.raises(InputError, match="another path"):
        force(path, Engagement((short,)))


def test_a_depth_beyond_the_cutter_is_refused(path: Toolpath) -> None:
    with pytest.raises(InputError, match="cutter's diameter"):
        force(path, radial_depth_mm=11.0)
