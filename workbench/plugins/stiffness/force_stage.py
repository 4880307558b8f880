"""`stiffness.force`: the milling force along a path."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    Cell,
    Cutter,
    Document,
    Engagement,
    Float,
    InputError,
    InputFile,
    Layer,
    LayerEngagement,
    Shaped,
    Toolpath,
    nearest,
    result_file,
    stage,
)
from workbench.plugins.ranges import HelixDeg, Positive
from workbench.plugins.stiffness.coefficients import PUBLISHED, CuttingCoefficients, read_coefficients
from workbench.plugins.stiffness.elastic import MM
from workbench.plugins.stiffness.values import CuttingProcess, LayerForce, MillingForce

DEPTHS = ("radial_mm", "axial_mm")  # of a layer, which the file of its forces does not repeat
STAND_IN = "al7075_t6"  # of a plate whose material nobody states
Pressure = Annotated[float, Field(ge=0, le=1e5)]
Six = tuple[Pressure, Pressure, Pressure, Pressure, Pressure, Pressure]


@stage("stiffness.force")
def force(
    toolpath: Toolpath,
    engagement: Engagement | None = None,
    cell: Cell | None = None,
    *,
    material: Literal["al6061_t6", "al6082_t6", "al7075_t6", "al7075_t6_ref160", "al7075_ref47", "al7075_hss"]
    | None = None,
    coefficients: Six | None = None,
    coefficients_file: InputFile | None = None,
    spindle_rpm: Positive = 6000.0,
    radial_depth_mm: Annotated[float | None, Field(gt=0, le=100)] = None,
    axial_depth_mm: Annotated[float | None, Field(gt=0, le=200)] = None,
    helix_deg: HelixDeg = 30.0,
    runout_mm: Annotated[float, Field(ge=0, le=1)] = 0.0,
) -> tuple[MillingForce, Document]:
    """Mechanistic milling force at every path point: mean vector and peak of a revolution (the paper's section 6.2).

    Feed, flutes and diameter come with the path. Forces act on the cutter, in each point's frame (docs/conventions.md).

    Args:
        toolpath: points, feed, cutter.
        engagement: what the cutter meets, as milled in simulation; without it the depths below hold all along.
        cell: the robot cell, whose file may state the workpiece's material.
        material: whose published coefficients to take; null: the cell's material, else al7075_t6.
        coefficients: instead: K_tc K_rc K_ac in N/mm^2, K_te K_re K_ae in N/mm (a count of six).
        coefficients_file: instead: a `coefficients.json` of `stiffness.identify_forces`, with u.
        spindle_rpm: number of turns a minute.
        radial_depth_mm: depth before the cutter, normal to the bevel face, without an engagement; null: the path's
            depth of cut.
        axial_depth_mm: cutting length, likewise; null: the width of the layer's bevel face.
        helix_deg: of the cutter, right-hand.
        runout_mm: distance of the cutter's axis from the spindle's, towards tooth 1.

    Raises:
        InputError: another path's engagement; a radial depth beyond the cutter's diameter; a material without published
            coefficients.

    Example:
        >>> from workbench import path, robot
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> force, file = stiffness.force(plan, None, cell)
        >>> file.name
        'milling_force.json'
    """
    of, assumed = _coefficients(cell, material, coefficients, coefficients_file)
    engaged = {} if engagement is None else {layer.index: layer for layer in engagement.layers}
    layers = []
    for layer in toolpath.layers:
        radial, axial = _depths(layer, engaged.get(layer.index), toolpath, radial_depth_mm, axial_depth_mm)
        if radial.max(initial=0) > toolpath.cutter.diameter_mm:
            raise InputError(
                f"layer {layer.index}",
                f"expected a radial depth of at most the cutter's diameter, found {radial.max():.3g} mm",
            )
        per_tooth = layer.feed_mm_s * 60 / (spindle_rpm * toolpath.cutter.flutes)
        met = toolpath.cutter, per_tooth, radial, axial, Teeth(helix_deg * DEG, runout_mm)
        met_edges = edges_in_cut(*met)
        through = met_edges.forces(of)
        acts = through[:, :, :3]
        peak = np.linalg.norm(acts, axis=2).argmax(axis=1)[:, None, None]
        u = None
        if of.covariance is not None:  # the mean force is linear in the coefficients
            each = met_edges.mean_matrices[:, :3]
            u = np.sqrt(np.einsum("kri,ij,krj->kr", each, of.covariance, each))
        layers.append(
            LayerForce(
                index=layer.index,
                arc_length_mm=layer.arc_length_mm,
                mean_n=acts.mean(axis=1),
                peak_n=np.take_along_axis(acts, peak, axis=1)[:, 0],
                torque_nm=through[:, :, 3].mean(axis=1),
                radial_mm=radial,
                axial_mm=axial,
                u_mean_n=u,
            )
        )
    process = CuttingProcess(of, helix_deg * DEG)
    found = MillingForce(tuple(layers), of.source, spindle_rpm, assumed, process)
    rows = [asdict(layer).items() for layer in found.layers]
    content = {
        "part": asdict(toolpath.part),
        "frame": "point",
        "coefficients": found.source,
        "spindle_rpm": found.spindle_rpm,
        "layers": [{name: one for name, one in row if name not in DEPTHS and one is not None} for row in rows],
    }
    return found, result_file("milling_force.json", content)


def _coefficients(
    cell: Cell | None, material: str | None, given: Six | None, file: Path | None
) -> tuple[CuttingCoefficients, str]:
    """Of the plate, and what is assumed of it."""
    if file is not None:
        if (given or material) is not None:
            raise InputError("stiffness.force", "expected a coefficients_file, or coefficients or a material, not both")
        return read_coefficients(file), ""
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


# Mechanistic milling force over one revolution of a cylindrical end mill (Altintas, Manufacturing Automation, 2012).
#
# In the frame of a path point: x into the material, y along the feed, z along the cutter's axis from shank to tip. A
# right-hand cutter turns positively about z, so its teeth meet the finished face first: up-milling, from no chip to
# the thickest. Angle phi of a tooth counts from x towards y; it cuts from 0 to acos(1 - a_e / R).

STEPS = 360  # of a revolution
SLICES = 40  # of the axial depth; of a tooth's way, by Gauss and Legendre, exact to rounding


class Teeth(NamedTuple):
    """How the teeth of a cutter stand."""

    helix: float = 0.0  # rad
    runout_mm: float = 0.0  # distance of the cutter's axis from the spindle's
    runout_angle: float = 0.0  # of tooth 1 against the runout, rad


class EdgesInCut(NamedTuple):
    """What the elements of cutting edges in a cut add up to, at angles of a revolution: all forces are linear in it."""

    sums: Shaped[Float, "k steps 2 3"]  # of chip times length, mm^2, and length, mm: by sine and cosine, and as it is
    radius_mm: float

    def forces(self, coefficients: CuttingCoefficients) -> Float:
        """Force on the cutter in N and torque that it asks of the spindle in Nm (k, steps, 4)."""
        return np.tensordot(self.sums, np.einsum("ocb,ce->ebo", _pushes(self.radius_mm), coefficients.table), axes=2)

    @property
    def mean_matrices(self) -> Shaped[Float, "k 4 6"]:
        """Their means over the revolution by the coefficients (order of NAMES)."""
        found = np.einsum("ocb,keb->koec", _pushes(self.radius_mm), self.sums.mean(axis=1))
        return np.asarray(found.reshape(*found.shape[:2], -1))


def edges_in_cut(
    cutter: Cutter,
    feed_per_tooth_mm: Shaped[Float, " k"],
    radial_mm: Shaped[Float, " k"],
    axial_mm: Shaped[Float, " k"],
    teeth: Teeth,
    steps: int = STEPS,
) -> EdgesInCut:
    """The elements of cutting edges in k cuts, through one revolution.

    On one of length db: F_t = (K_tc h + K_te) db against its motion, F_r = (K_rc h + K_re) db towards the axis,
    F_a = (K_ac h + K_ae) db towards the tip (right-hand helix). The chip h is what the tooth takes beyond the teeth
    before it (Kline and DeVor 1983): the least of m f sin(phi) and the difference in radius to the m-th one back.

    Args:
        cutter: diameter and flutes.
        feed_per_tooth_mm: (k,)
        radial_mm: (k,) radial depth of cut, 0 to the diameter.
        axial_mm: (k,) axial depth of cut, from the tip.
        teeth: how they stand.
        steps: angles of a revolution.
    """
    radius, tooth = cutter.diameter_mm / 2, np.arange(cutter.flutes)
    behind = 2 * np.pi / cutter.flutes * tooth  # of the first tooth
    offset = teeth.runout_mm * np.cos(teeth.runout_angle - behind)
    spindle_angle = 2 * np.pi * (np.arange(steps) + 0.5) / steps
    met = np.broadcast_arrays(feed_per_tooth_mm, radial_mm, axial_mm)
    found = np.zeros((np.size(met[0]), steps, 2, 3))
    for sums, feed, radial, axial in zip(found, *(part.reshape(-1) for part in met), strict=True):
        if radial <= 0.0 or axial <= 0.0:
            continue
        db, last = axial / SLICES, np.arccos(max(1.0 - radial / radius, -1.0))
        lag = np.tan(teeth.helix) * (np.arange(SLICES) + 0.5) * db / radius
        phi = (spindle_angle[:, None, None] - behind[:, None] - lag) % (2 * np.pi)
        step, j, _ = np.nonzero(phi <= last)
        angle = phi[phi <= last]
        chip = np.min([m * feed * np.sin(angle) + offset[j] - offset[j - m] for m in tooth + 1], axis=0)
        cuts, ways = (chip > 0.0) * db, _ways(angle)
        each = [[np.bincount(step, of * way, steps) for way in ways] for of in (cuts * chip, cuts)]
        sums[:] = np.moveaxis(np.array(each), -1, 0)
    return EdgesInCut(found, radius)


def mean_matrices(cutter: Cutter, entry: float, exit_: float, chip_mm: Shaped[Float, " k"]) -> Shaped[Float, "k 4 6"]:
    """Mean force, N, and torque, Nm, of a turn on a mm of depth, linear in the coefficients (order of NAMES).

    Averages of what `edges_in_cut` adds up from `entry` to `exit_`, rad (Altintas 2012, section 2.8), at feeds per
    tooth `chip_mm` (k,), along y, or against it where the entry is negative (down-milling).
    """
    node, weight = np.polynomial.legendre.leggauss(SLICES)
    phi, share = (entry + exit_ + (exit_ - entry) * node) / 2, cutter.flutes * (exit_ - entry) / (4 * np.pi) * weight
    pushes, feed = _pushes(cutter.diameter_mm / 2), chip_mm if entry >= 0 else -chip_mm
    of_chip, of_edge = feed[:, None, None] * (pushes @ _ways(phi) @ (share * np.sin(phi))), pushes @ _ways(phi) @ share
    return np.concatenate([of_chip, np.broadcast_to(of_edge, of_chip.shape)], axis=2)


def _ways(phi: Shaped[Float, " n"]) -> Shaped[Float, "3 n"]:
    """Sine, cosine and 1 of angles of an edge."""
    return np.stack([np.sin(phi), np.cos(phi), np.ones_like(phi)])


def _pushes(radius_mm: float) -> Shaped[Float, "4 3 3"]:
    """Force on the cutter and torque, Nm, by 1 N against an edge's motion, towards the axis and towards the tip.

    Each by sine and cosine of the edge's angle and 1.
    """
    sine, cosine, whole = np.eye(3)
    none = np.zeros(3)
    rows = [[sine, -cosine, none], [-cosine, -sine, none], [none, none, whole], [radius_mm / MM * whole, none, none]]
    return np.array(rows)
