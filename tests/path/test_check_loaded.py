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


@pytest.mark.parametrize(
    ("depth_mm", "share", "told", "passes"),
    [
        (-0.12, 1.0, True, True),
        (-0.12, 1.0, False, False),  # as commanded it cuts too deep
        (-0.12, 0.5, True, False),
        (-0.12, 2.0, True, False),
        (-0.12, 0.0, True, False),
        (-0.9, 1.0, True, True),
        (-1.5, 1.0, True, False),  # unloaded the cutter is that much deeper: a wild prediction is no leave to cut there
    ],
)
def test_a_corrected_path_passes_with_its_own_prediction_alone(raw, depth_mm, share, told, passes):
    scan = raw()
    path, loaded = scan.plan, deflection(scan.plan, [depth_mm, *AWAY_MM[1:]])
    corrected = compensate(path, loaded, share=share)
    gate = check(corrected, scan.edge, scan.cloud, loaded if told else None)
    assert gate.passed == passes, gate.reason
    assert gate.toolpath is corrected
    assert told or "is not at its height" in gate.reason
    turn = Rotation.from_quat(path.layers[0].quaternion_wxyz, scalar_first=True)
    moved = share * turn.apply(loaded.by_layer_mm[path.layers[0].index])
    assert np.allclose(corrected.layers[0].position_mm + moved, path.layers[0].position_mm, atol=1e-9)


def test_a_prediction_of_another_path_is_refused(raw: Callable[..., Raw]) -> None:
    scan = raw()
    path = scan.plan
    for wrong in ({}, {1: np.zeros((3, 3))}, {k: v * np.nan for k, v in deflection(path).by_layer_mm.items()}):
        with pytest.raises(InputError, match="a deflection for each of the"):
            check(path, scan.edge, scan.cloud, PathDeflection(wrong))


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
