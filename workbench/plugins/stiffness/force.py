"""`stiffness.force`: the milling force along a path."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    Cell,
    Document,
    Engagement,
    Float,
    InputError,
    Layer,
    LayerEngagement,
    Part,
    Toolpath,
    nearest,
    rotation_from_quaternion,
    stage,
    strict_json,
)
from workbench.plugins.stiffness.coefficients import PUBLISHED, CuttingCoefficients
from workbench.plugins.stiffness.cutting import milling_force
from workbench.plugins.stiffness.values import LayerForce, MillingForce

STAND_IN = "al7075_t6"  # of a plate whose material nobody states
Pressure = Annotated[float, Field(ge=0, le=1e5)]
Six = tuple[Pressure, Pressure, Pressure, Pressure, Pressure, Pressure]


@stage("stiffness.force")
def force(
    toolpath: Toolpath,
    engagement: Engagement | None = None,
    cell: Cell | None = None,
    *,
    material: Annotated[
        Literal["al6061_t6", "al6082_t6", "al7075_t6", "al7075_t6_ref160", "al7075_ref47", "al7075_hss"] | None,
        Field(description="published coefficients; null: the cell's material, or al7075_t6 stands in"),
    ] = None,
    coefficients: Annotated[
        Six | None, Field(description="instead: K_tc K_rc K_ac in N/mm^2, K_te K_re K_ae in N/mm (a count of six)")
    ] = None,
    spindle_rpm: Annotated[float, Field(gt=0, le=1e5, description="ratio of spindle turns to minutes")] = 6000.0,
    radial_depth_mm: Annotated[
        float | None, Field(gt=0, le=100, description="where no engagement is known; null: the path's depth of cut")
    ] = None,
    axial_depth_mm: Annotated[
        float | None, Field(gt=0, le=200, description="likewise; null: the width of the layer's bevel face")
    ] = None,
    helix_deg: Annotated[float, Field(ge=0, le=60, description="of the cutter, right-hand")] = 30.0,
    runout_mm: Annotated[float, Field(ge=0, le=1, description="of the cutter against the spindle")] = 0.0,
    runout_angle_deg: Annotated[float, Field(ge=0, le=360, description="of tooth 1 against the runout")] = 0.0,
) -> tuple[MillingForce, Document]:
    """Mechanistic milling force at every path point: mean vector and peak of a revolution (the paper's section 6.2).

    Defaults are the paper's case: 6000 rpm; 1 mm/s, 1 mm, 4 flutes and 10 mm come with the path. Its workpiece and
    coefficients are not given: those of an aluminium alloy stand in.

    Args:
        toolpath: points, feed, cutter.
        engagement: what the cutter meets, as milled in simulation; without it the depths below hold all along.
        cell: the robot cell, whose file may state the workpiece's material.
        material: whose published coefficients to take.
        coefficients: six of one's own.
        spindle_rpm: turns a minute.
        radial_depth_mm: depth of material before the cutter, normal to the bevel face.
        axial_depth_mm: length of the cutter that cuts.
        helix_deg: of the cutter.
        runout_mm: distance of the cutter's axis from the spindle's.
        runout_angle_deg: of tooth 1 against it.

    Raises:
        InputError: the engagement is of another path; a radial depth beyond the cutter's diameter; a material in the
            cell file that has no published coefficients.

    Example:
        >>> from workbench import path, robot
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> force, file = stiffness.force(plan, None, cell)
        >>> file.name
        'milling_force.json'
    """
    of, assumed = _coefficients(cell, material, coefficients)
    met = {} if engagement is None else {layer.index: layer for layer in engagement.layers}
    layers = []
    for layer in toolpath.layers:
        radial, axial = _depths(layer, met.get(layer.index), toolpath, radial_depth_mm, axial_depth_mm)
        if radial.max(initial=0) > toolpath.cutter.diameter_mm:
            raise InputError(
                f"layer {layer.index}",
                f"expected a radial depth of at most the cutter's diameter, found {radial.max():.3g} mm",
            )
        per_tooth = layer.feed_mm_s * 60 / (spindle_rpm * toolpath.cutter.flutes)
        through = milling_force(
            of,
            toolpath.cutter,
            per_tooth,
            radial,
            axial,
            helix=helix_deg * DEG,
            runout_mm=runout_mm,
            runout_angle=runout_angle_deg * DEG,
        )
        layers.append(_layer_force(layer, through))
    found = MillingForce(tuple(layers), of.source, assumed)
    return found, Document("milling_force.json", _document(found, toolpath.part))


def _coefficients(cell: Cell | None, material: str | None, given: Six | None) -> tuple[CuttingCoefficients, str]:
    """Of the plate, and what is assumed of it."""
    if given is not None:
        return CuttingCoefficients(*given), ""
    if material is None and cell is not None and cell.material is not None:
        material = cell.material
        if material not in PUBLISHED:
            raise InputError(
                f"{cell.source}: $.workpiece.material",
                f"expected one of {', '.join(PUBLISHED)}{nearest(material, PUBLISHED)}",
            )
    if material is not None:
        return PUBLISHED[material], ""
    return PUBLISHED[STAND_IN], f"the material of the plate: coefficients of {STAND_IN} stand in ($.workpiece.material)"


def _depths(
    layer: Layer, met: LayerEngagement | None, toolpath: Toolpath, radial_mm: float | None, axial_mm: float | None
) -> tuple[Float, Float]:
    """Radial and axial depth at each point; 0 in travel moves."""
    if met is not None:
        if len(met.arc_length_mm) != len(layer.arc_length_mm):
            raise InputError(f"layer {layer.index}", "the engagement is of another path: expected as many points")
        return met.radial_depth_mm, met.axial_depth_mm
    radial = np.full(len(layer.arc_length_mm), radial_mm if radial_mm is not None else toolpath.depth_of_cut_mm)
    axial = layer.width_mm if axial_mm is None else np.full(len(radial), axial_mm)
    return np.where(layer.cutting, radial, 0.0), np.where(layer.cutting, axial, 0.0)


def _layer_force(layer: Layer, through: Float) -> LayerForce:
    """Mean and peak of a revolution (k, steps, 3), in the point's axes and in the path's frame."""
    rotation = rotation_from_quaternion(layer.quaternion_wxyz)
    size = np.linalg.norm(through, axis=2)
    peak = np.take_along_axis(through, size.argmax(axis=1)[:, None, None], axis=1)[:, 0]
    mean = through.mean(axis=1)
    return LayerForce(
        index=layer.index,
        arc_length_mm=layer.arc_length_mm,
        mean_n=mean,
        peak_n=peak,
        mean_in_path_n=(rotation @ mean[..., None])[..., 0],
        peak_in_path_n=(rotation @ peak[..., None])[..., 0],
    )


def _document(found: MillingForce, part: Part) -> bytes:
    return strict_json(
        {
            "format": "milling-force",
            "version": 1,
            "part": asdict(part),
            "coefficients": found.source,
            "layers": [
                {
                    "index": layer.index,
                    "arc_length_mm": layer.arc_length_mm,
                    "mean_n": layer.mean_n,
                    "peak_n": layer.peak_n,
                }
                for layer in found.layers
            ],
        }
    )
