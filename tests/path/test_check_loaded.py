"""Checks of a path that allows for deflection, and what loosens or defeats the checks of any path."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.path.conftest import Raw
from workbench.artefacts import PathDeflection, Toolpath
from workbench.errors import InputError
from workbench.path import check, feed, layers
from workbench.plugins.stiffness import compensate

AWAY_MM = np.array([-0.12, 0.03, 0.02])  # x away from the material, in the points' frames


def deflection(path: Toolpath, away_mm: object = AWAY_MM) -> PathDeflection:
    """The robot gives way where it cuts."""
    return PathDeflection({layer.index: layer.cutting[:, None] * np.array(away_mm) for layer in path.layers})


def test_a_corrected_path_passes_where_the_loaded_cutter_comes(raw: Callable[..., Raw]) -> None:
    scan = raw()
    path = scan.plan
    corrected = compensate(path, deflection(path))
    turn = Rotation.from_quat(path.layers[0].quaternion_wxyz, scalar_first=True)
    moved = turn.apply(path.layers[0].cutting[:, None] * AWAY_MM)
    assert np.allclose(corrected.layers[0].position_mm + moved, path.layers[0].position_mm, atol=1e-9)
    gate = check(corrected, scan.edge, scan.cloud, deflection(path))
    assert gate.passed, gate.reason
    assert gate.toolpath is corrected


def test_without_its_prediction_a_corrected_path_is_refused(raw: Callable[..., Raw]) -> None:
    """As commanded it cuts too deep."""
    scan = raw()
    path = scan.plan
    gate = check(compensate(path, deflection(path)), scan.edge, scan.cloud)
    assert not gate.passed
    assert "is not at its height" in gate.reason


@pytest.mark.parametrize("wrong", [{"share": 0.5}, {"share": 2.0}, {"share": 0.0}])
def test_too_little_or_too_much_correction_is_refused(raw: Callable[..., Raw], wrong: dict[str, float]) -> None:
    scan = raw()
    path = scan.plan
    gate = check(compensate(path, deflection(path), **wrong), scan.edge, scan.cloud, deflection(path))
    assert not gate.passed


def test_a_prediction_of_another_path_is_refused(raw: Callable[..., Raw]) -> None:
    scan = raw()
    path = scan.plan
    for wrong in ({}, {1: np.zeros((3, 3))}, {k: v * np.nan for k, v in deflection(path).by_layer_mm.items()}):
        with pytest.raises(InputError, match="a deflection for each point of layer"):
            check(path, scan.edge, scan.cloud, PathDeflection(wrong))


def test_a_great_deflection_is_refused_whatever_allows_for_it(raw: Callable[..., Raw]) -> None:
    """Unloaded, the cutter of the corrected path is that much deeper: a wild prediction is no leave to cut there."""
    scan = raw()
    path = scan.plan
    for depth, fine in ((-0.9, True), (-1.5, False)):
        wild = deflection(path, [depth, 0, 0])
        gate = check(compensate(path, wild), scan.edge, scan.cloud, wild)
        assert gate.passed == fine, gate.reason


def test_the_commanded_path_is_held_against_clamps_too(raw: Callable[..., Raw]) -> None:
    """The loaded cutter would come where it should, over the clamp; unloaded it would be in it."""
    scan = raw(
        part={"length_mm": 94.0, "clamps": [{"from_mm": 40, "to_mm": 54, "height_mm": 12}]},
        passes=[{"from_mm": 2.0, "to_mm": 92.0}],
    )
    path = scan.plan
    over = PathDeflection({k.index: np.where(k.measured[:, None], 0.0, [-12.0, 0, 0]) for k in path.layers})
    gate = check(compensate(path, over), scan.edge, scan.cloud, over)
    assert not gate.passed


def test_a_travel_through_thick_stock_is_seen_with_a_thin_cutter(raw: Callable[..., Raw]) -> None:
    """1.5 depths of cut are more than its radius: what it may meet beside its cut must not hide a collision."""
    scan = raw()
    path = feed(layers(scan.edge, scan.cloud, cutter_diameter_mm=2.4, depth_of_cut_mm=1.0), scan.cloud, scan.edge)
    assert check(path, scan.edge, scan.cloud).passed
    last = path.layers[-1]
    ends = [
        replace(
            t,
            position_mm=last.position_mm[[15, -15]],
            quaternion_wxyz=last.quaternion_wxyz[[15, -15]],
            feed_mm_s=np.full(2, 1.0),
        )
        if i == 0
        else t
        for i, t in enumerate(path.travels)
    ]
    gate = check(replace(path, travels=tuple(ends)), scan.edge, scan.cloud)
    assert not gate.passed
    assert "the stock" in gate.reason
