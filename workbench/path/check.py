"""`path.check`: may this path be run? Its own checks, from the edge and the cloud, not from how it was planned."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Annotated

from pydantic import Field

from workbench.artefacts import Cloud, Edge, Gate, Toolpath
from workbench.path.collisions import collisions
from workbench.path.feed_checks import feed_faults
from workbench.path.frame_checks import frame_faults
from workbench.path.layer_checks import layer_faults
from workbench.stage import stage

MOST_TOLD = 3  # faults that the reason names


@stage("path.check")
def check(
    toolpath: Toolpath,
    edge: Edge,
    cloud: Cloud,
    *,
    v_fast_mm_s: Annotated[float | None, Field(gt=0, le=5000, description="no feed is greater; null: no limit")] = None,
    acceleration_mm_s2: Annotated[float, Field(gt=0, le=1e5, description="nor is the feed's change, per time")] = 50.0,
    penetration_mm: Annotated[
        float, Field(gt=0, le=2, description="how deep the cutter may touch what must remain, besides 3 u of the edge")
    ] = 0.05,
) -> Gate:  # fmt: skip
    """Check a path against the edge and the cloud. A program is written only for a path that passes.

    Layers: the last one lies on the finished bevel, none below it; each takes no more than the depth of cut, and some
    point of the cloud away; key points every 1 mm; nothing is cut where nothing was measured. Frames: y along the edge,
    the cutter's axis in the bevel face, shank on the upper side, x into the material, no jump. The cutter as a
    cylinder, without end on the shank's side: it meets no clamp, and enters nothing that remains after its layer, by
    more than `penetration_mm` + 3 u. Feeds within v_slow and v_fast and the acceleration.

    Args:
        toolpath: the path.
        edge: the edge that it mills.
        cloud: the scan.
        v_fast_mm_s: greatest feed; null: not checked.
        acceleration_mm_s2: greatest change of the feed.
        penetration_mm: how deep the cutter may touch what must remain.
    """
    faults = list(_first(chain(
        layer_faults(toolpath, edge), frame_faults(toolpath, edge),
        feed_faults(toolpath, v_fast_mm_s, acceleration_mm_s2), collisions(toolpath, edge, cloud, penetration_mm),
    )))  # fmt: skip
    if faults:
        more = "; and more" if len(faults) > MOST_TOLD else ""
        return Gate(False, f"path refused: {'; '.join(faults[:MOST_TOLD])}{more}")
    points = sum(len(layer.arc_length_mm) for layer in toolpath.layers)
    return Gate(True, f"path checked: {len(toolpath.layers)} layers, {points} points")


def _first(faults: Iterator[str]) -> Iterator[str]:
    """As many faults as are told, and one more; the costly checks come last and wait for the others."""
    for count, fault in enumerate(faults):
        yield fault
        if count == MOST_TOLD:
            return
