"""`cloud.register`: a cloud from anywhere laid on another one."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Document, PointSet, frozen
from workbench.children import in_one_thread
from workbench.cloud.read_stage import in_process, unit_stated
from workbench.cloud.units import MM, Unit
from workbench.errors import InputError
from workbench.geometry.coarse import coarse_registration, fine_registration
from workbench.geometry.poses import mapped
from workbench.result_files import result_file
from workbench.stage import InputFile, Seed, stage

LEAST_POINTS = 100


@stage("cloud.register")
def register(
    points: PointSet,
    *,
    reference: InputFile,
    unit: Unit | None = None,
    voxel_mm: Annotated[float, Field(gt=0, le=100)] = 1.0,
    reach_mm: Annotated[float, Field(gt=0, le=100)] = 0.5,
    least_overlap: Annotated[float, Field(gt=0, le=1)] = 0.5,
    seed: Seed = 0,
) -> tuple[PointSet, Document]:
    """Register a cloud without a start: Open3D's features and RANSAC, then point-to-plane ICP.

    The cloud comes back in the reference's frame, with the pose in `cloud_registration.json`. A covariance and open
    directions: `compare.register`.

    Args:
        points: a cloud without a grid.
        reference: the cloud or mesh to lie on.
        unit: of the reference's coordinates; null: as `cloud.read`.
        voxel_mm: to which both are thinned for the coarse registration by features.
        reach_mm: greatest distance of corresponding points at the end.
        least_overlap: least share of the cloud on the reference.
        seed: of RANSAC.

    Raises:
        InputError: an unusable reference, or too little overlap.

    Example:
        >>> from workbench import cloud
        >>> part = cloud.read(file="data/synthetic/milled_edge.laz")
        >>> from workbench.artefacts import PointSet
        >>> thin = PointSet.from_open3d(part.to_open3d().to_legacy().voxel_down_sample(0.5))
        >>> moved, document = cloud.register(thin, reference="data/synthetic/milled_edge.laz")
        >>> document.name, moved.points_mm.shape == thin.points_mm.shape
        ('cloud_registration.json', True)
    """
    target = in_process(reference) * MM[unit or unit_stated(reference) or "mm"]
    target = target[np.isfinite(target).all(axis=1)]
    if min(len(target), len(points.points_mm)) < LEAST_POINTS:
        raise InputError(str(reference), f"expected at least {LEAST_POINTS} points in both clouds")
    start = in_one_thread(coarse_registration, points.points_mm, target, voxel_mm, seed)[0]
    pose, overlap, rms = in_one_thread(fine_registration, points.points_mm, target, start.target_from_source, reach_mm)
    if overlap < least_overlap:
        raise InputError(
            points.source or "cloud.register",
            f"only {100 * overlap:.0f} % lies within {reach_mm:g} mm of {reference}: expected "
            f"{100 * least_overlap:.0f} %; another part, another unit, or a larger voxel_mm or reach_mm",
        )
    content = {
        "part": asdict(points.part),
        "reference": str(reference),
        "source": points.source,
        "reference_from_cloud": pose,
        "overlap": overlap,
        "rms_mm": rms,
        "reach_mm": reach_mm,
        "voxel_mm": voxel_mm,
    }
    moved = mapped(pose, points.points_mm)
    return replace(points, points_mm=frozen(moved)), result_file("cloud_registration.json", content)
