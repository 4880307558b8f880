"""Where the loaded cutter comes, by a prediction of how far the robot gives way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.artefacts import Layer, PathDeflection, Toolpath
from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation, rotation_from_quaternion, rotation_from_vector
from workbench.geometry.tool_frames import same_sign
from workbench.units import Float


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
    turn = predicted.turn_by_layer.get(layer.index)
    quaternion = layer.quaternion_wxyz if turn is None else turned_about_feed(layer.quaternion_wxyz, turn)
    return replace(layer, position_mm=layer.position_mm + away, quaternion_wxyz=quaternion)


def turned_about_feed(quaternion_wxyz: Float, angle: Float) -> Float:
    """Tool frames (k, 4) turned by angles (k,) rad about their own y."""
    turn = rotation_from_vector(np.asarray(angle)[:, None] * np.array([0.0, 1.0, 0.0]))
    return same_sign(quaternion_from_rotation(rotation_from_quaternion(quaternion_wxyz) @ turn))
