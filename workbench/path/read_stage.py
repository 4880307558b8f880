"""`path.read`: a milling path from a `toolpath.json`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.artefacts import UNKNOWN_PART, Cutter, Gate, Layer, Toolpath, Travel
from workbench.artefacts.decisions import SHAPE_ONLY
from workbench.errors import InputError
from workbench.geometry.poses import is_rigid, rotation_from_quaternion, unit
from workbench.stage import InputFile, stage
from workbench.storage import MOST_BYTES
from workbench.strict_json import content_digest
from workbench.units import Float

if TYPE_CHECKING:
    from workbench.result_files.contract import LayerRow, ToolpathFile, TravelPoint

STRETCH = 5.0  # of a path against the lower edge at a tight turn; cm and inches differ by 10 and more
LEAST_FEED_MM_S = 0.05  # 3 mm/min: no bevel is milled more slowly
AHEAD = 0.5  # cosine of y with the advance: of a file in another order it is any
PLACE_UNSAID = f"{SHAPE_ONLY}the file does not say what shows where the part stands in the robot's base"


@stage("path.read")
def read(*, toolpath: InputFile) -> Toolpath:
    """Read a milling path from a `toolpath.json`, its own or another program's.

    Travels, requirements, check, and the width of the cut face (then the depth of cut) may be absent. Positions in mm,
    in the frame that the file names.

    Args:
        toolpath: a toolpath.json (docs/pipelines.md).

    Raises:
        InputError: not such a file; the place in it and what was expected.

    Example:
        >>> from workbench import path
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> len(plan.layers), plan.root_mm, plan.bevel_deg
        (5, 1.5, 40.0)
    """
    from workbench.result_files import ToolpathFile  # the models take time to build: where there is something to read

    file, where = ToolpathFile.read(toolpath, MOST_BYTES), f"{toolpath}: $"
    needs, depth, last = file.requirements, file.requirements.depth_of_cut_mm, len(file.layers) - 1
    layers = tuple(_layer(row, depth, last - i) for i, row in enumerate(file.layers))
    cut = [point for row in file.layers for point in row.points if point.cutting]
    if not cut:
        raise InputError(f"{where}.layers", "expected points that cut, found none")
    fastest = max(point.feed_mm_s for point in cut)
    if fastest < LEAST_FEED_MM_S:
        expected = f"expected feeds of {LEAST_FEED_MM_S:g} mm/s and more, found {fastest:.3g} at most: in m/s?"
        raise InputError(f"{where}.layers", expected)
    for i, layer in enumerate(layers):
        _check_advance(layer, f"{where}.layers[{i}].points")
    cutter = file.cutter
    return Toolpath(
        cutter=Cutter(
            cutter.diameter_mm, cutter.flutes, cutter.flute_length_mm or Cutter().flute_length_mm, cutter.ball_end
        ),
        layers=layers,
        travels=tuple(Travel(**_poses(row.points)) for row in file.travels),
        v_slow_mm_s=min(point.feed_mm_s for point in cut),
        edge_length_mm=file.edge_length_mm or max(point.arc_length_mm for point in cut),
        base_from_workobject=_frame(file, where),
        source=str(toolpath),
        part=file.part or UNKNOWN_PART,
        root_mm=needs.root_mm,
        bevel_deg=needs.bevel_deg,
        depth_of_cut_mm=depth,
        root_radius_mm=needs.root_radius_mm,
        claim=_claim(file),
        evidence=tuple(file.evidence),
        chain=file.chain,
    )


def _layer(row: LayerRow, depth_mm: float, above: int) -> Layer:
    """One layer; its height and the widths it cuts are optional."""
    points = row.points
    width = [depth_mm * p.cutting if p.width_mm is None else p.width_mm for p in points]
    return Layer(
        index=row.index,
        height_mm=above * depth_mm if row.height_mm is None else row.height_mm,
        arc_length_mm=np.array([p.arc_length_mm for p in points]),
        cutting=np.array([p.cutting for p in points]),
        measured=np.array([p.measured for p in points]),
        width_mm=np.array(width, float),
        **_poses(points),
    )


def _check_advance(layer: Layer, where: str) -> None:
    """Where a layer cuts, positions advance as the arc length does, and along y of their frames.

    Raises:
        InputError: they do not; what the unit or the order of the quaternions may be.
    """
    cuts = layer.cutting[1:] & layer.cutting[:-1] & (np.diff(layer.arc_length_mm) > 0)
    if not cuts.any():
        return
    step, y = np.diff(layer.position_mm, axis=0), rotation_from_quaternion(layer.quaternion_wxyz)[1:, :, 1]
    length = np.linalg.norm(step, axis=1)
    ratio = float(np.median(length[cuts] / np.diff(layer.arc_length_mm)[cuts]))
    if not 1 / STRETCH < ratio < STRETCH:
        unit = "in another unit than mm, such as m, cm or inches?" if ratio < 1 else "in another unit than mm?"
        raise InputError(where, f"positions advance by {ratio:.3g} mm a mm of arc length, expected about 1: {unit}")
    along = float(np.median((step * y).sum(axis=1)[cuts] / np.maximum(length[cuts], 1e-9)))
    if along < AHEAD:
        off = np.degrees(np.arccos(np.clip(along, -1, 1)))
        raise InputError(where, f"expected y along the feed, found it {off:.0f} deg off: is w the quaternions' first?")


def _poses(points: list[Any] | list[TravelPoint]) -> dict[str, Float]:
    """Positions, unit quaternions and feeds of points; q and -q are one rotation: each follows the one before."""
    turns = unit(np.array([point.quaternion_wxyz for point in points]))
    flips = np.where((turns[1:] * turns[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    return {
        "position_mm": np.array([point.position_mm for point in points]),
        "quaternion_wxyz": turns * np.cumprod(np.append(1.0, flips))[:, None],
        "feed_mm_s": np.array([point.feed_mm_s for point in points]),
    }


def _frame(file: ToolpathFile, where: str) -> Float | None:
    """`base_from_workobject`, or None for positions in the base."""
    if file.frame == "base":
        return None
    pose = np.array(file.base_from_workobject or [], float)
    if pose.shape != (4, 4) or not is_rigid(pose):
        raise InputError(f"{where}.base_from_workobject", "expected a rigid motion, 4x4")
    return pose


def _claim(file: ToolpathFile) -> Gate | None:
    """What the file says of its check; a refusal where the path is no longer the one that was checked."""
    said = file.check
    if said is None:
        return None
    if said.sha256 != content_digest({key: part for key, part in file.document.items() if key != "check"}):
        return Gate(False, "the path was changed after its check")
    known = said.placed or any(text.startswith(SHAPE_ONLY) for text in said.loosened)
    loosened = tuple(said.loosened) if known else (PLACE_UNSAID, *said.loosened)
    return Gate(said.passed, said.reason, loosened, tuple(said.unchecked))
