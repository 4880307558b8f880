"""Where the loaded cutter comes, by a prediction of how far the robot gives way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.artefacts import Layer, PathDeflection, Toolpath
from workbench.errors import InputError
from workbench.geometry.poses import rotation_from_quaternion


def loaded(toolpath: Toolpath, predicted: PathDeflection) -> Toolpath:
    """The path displaced by the prediction, point by point; InputError where that is of another path."""
    return replace(toolpath, layers=tuple(_displaced(layer, predicted) for layer in toolpath.layers))


def greatest_mm(predicted: PathDeflection) -> float:
    """The largest displacement anywhere."""
    return max((float(np.linalg.norm(d, axis=1).max(initial=0.0)) for d in predicted.by_layer_mm.values()), default=0.0)


def _displaced(layer: Layer, predicted: PathDeflection) -> Layer:
    moved = predicted.by_layer_mm.get(layer.index)
    if moved is None or moved.shape != layer.position_mm.shape or not np.isfinite(moved).all():
        raise InputError("path.check", f"expected a deflection for each point of layer {layer.index} of this path")
    away = (rotation_from_quaternion(layer.quaternion_wxyz) @ moved[:, :, None])[:, :, 0]
    return replace(layer, position_mm=layer.position_mm + away)
