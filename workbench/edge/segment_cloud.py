"""`edge.segment_cloud`: the faces of the edge and its lower edge, from a cloud without a grid."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from workbench.artefacts import Cloud, Edge, PointSet
from workbench.edge.segment import segment
from workbench.edge.segment_cloud_grid import recovered_grid
from workbench.edge.segment_cloud_slices import Nominal, slice_cloud
from workbench.stage import stage


@stage("edge.segment_cloud")
def segment_cloud(
    points: PointSet,
    *,
    root_nominal_mm: Annotated[
        float, Field(gt=0, le=50, description="expected root size, tells the faces apart")
    ] = 1.5,
    bevel_nominal_deg: Annotated[float, Field(ge=20, le=70, description="expected bevel angle, likewise")] = 40.0,
    robot_noise_mm: Annotated[
        float, Field(ge=0, le=5, description="standard deviation of the positions that the cloud was fused with")
    ] = 0.07,
    use_order: Annotated[bool, Field(description="look for scan lines in the order of the points")] = True,
) -> tuple[Cloud, Edge]:
    """Find root face, bevel face and the lower edge of a milled edge in a cloud without a grid.

    The cloud becomes an organised one, and the edge is then that of `edge.segment`. Where the points still stand in the
    order in which a line scanner took them, its grid is found again: each scan line lies in one plane, and its columns
    are equal steps along one axis of that. Else the cloud is sliced: Open3D's surface normals tell in which direction
    the edge runs, trial slices from which side its two faces show, a first pass its course; slices square to that, as
    thick as the points are apart, are the profiles.

    Args:
        points: the cloud of one edge, in mm.
        root_nominal_mm: expected root size; only tells the faces apart.
        bevel_nominal_deg: expected bevel angle; likewise.
        robot_noise_mm: standard deviation of the positions that the cloud was fused with, each axis: nothing in the
            cloud shows it, yet it turns the edge's tangent.
        use_order: look for scan lines in the order of the points; false: slice the cloud in any case.

    Returns:
        The organised cloud, for reports and planning, and its edge.

    Raises:
        InputError: no root face next to a bevel face in view.
    """
    cloud = recovered_grid(points) if use_order else None
    if cloud is None:
        cloud = slice_cloud(points, Nominal(root_nominal_mm, bevel_nominal_deg))
    edge = segment(
        cloud, root_nominal_mm=root_nominal_mm, bevel_nominal_deg=bevel_nominal_deg, robot_noise_mm=robot_noise_mm
    )
    return cloud, edge
