"""The end face of a raw edge, its two ends and the plate's surfaces in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.edge.raw_clamps import not_in_front
from workbench.errors import InputError
from workbench.geometry import end_face
from workbench.geometry.blocks import as_input, over_blocks
from workbench.geometry.faces import FaceLines
from workbench.units import AnyArray, Bool, Float

LABELS = np.array([ROOT_FACE, UPPER_SURFACE, LOWER_SURFACE])  # in the order of geometry.end_face
BURR_POINTS = 3  # that stand out in a frame


@dataclass(frozen=True, slots=True, eq=False)
class FaceEnds:
    """One end of the end face in each of N frames; NaN where the frame does not show it."""

    corner: Bool  # (N,) the surface that joins the face there is seen
    point: Float  # (N, 2) x, z: the corner's virtual sharp edge, or the face's last return; profiler frame, mm
    column: Float  # (N,) of the last return, counted outwards
    pitch: Float  # (N,) distance of the columns in x, mm; 0 at a corner
    slope: Float  # (N,) dz/dx of the face next to its last return
    alone: Bool  # (N,) the next column saw both the face and what lies behind it
    burred: Bool  # (N,) points stand out beside the edge


@dataclass(frozen=True, slots=True, eq=False)
class RawFaces:
    """What the frames show of a raw edge, for all N frames of a cloud."""

    faces: dict[int, FaceLines]  # by label; of the end face without its margins
    whole: FaceLines  # the end face from edge to edge
    lower: FaceEnds
    upper: FaceEnds
    seen: Bool  # (N,) the end face is seen
    side: Float  # (N,) the upper side lies towards falling side * x
    sense: float  # +1: z counts away from the sensor
    labels: AnyArray  # (N, M) uint8


def find_end_face(cloud: Cloud, along: Float, sense: float) -> RawFaces:
    """Read the end face in every frame; along (N, 2): its rough direction there, towards the upper side.

    Raises InputError where no frame shows it, or where one of its ends is never seen.
    """
    n, columns = cloud.x_mm.shape
    sums, ends = np.zeros((n, 4, 8)), np.full((n, 2, 8), np.nan)
    seen, labels = np.zeros(n, bool), np.zeros((n, columns), np.uint8)
    grid = as_input(cloud.x_mm), as_input(cloud.z_mm), as_input(cloud.keep)
    known = as_input(along), sense, as_input(LABELS)
    over_blocks(lambda i, j: end_face.read_frames(*grid, *known, sums, ends, seen, labels, i, j), (n, columns))
    found = _gather(sums, ends, seen, -np.sign(along[:, 0]), sense, labels)
    hidden = seen & ~not_in_front(
        middle_of(cloud, found.faces[ROOT_FACE]), outward_of(cloud, found), seen, cloud.pass_index
    )
    labels[hidden] = 0
    found = _gather(sums, ends, seen & ~hidden, found.side, sense, labels)
    for name, end in (("lower", found.lower), ("upper", found.upper)):
        if np.isfinite(end.point[:, 0]).sum() < 3:
            raise InputError(
                cloud.source,
                f"{name} edge not in view: the end face runs out of the field of view, behind something, or into "
                "another face in every frame",
            )
    return found


def _gather(sums: Float, ends: Float, seen: Bool, side: Float, sense: float, labels: AnyArray) -> RawFaces:
    """What the kernel reports, for the frames `seen`."""
    faces = {int(label): _face_lines(sums[:, f], seen) for f, label in enumerate(LABELS)}
    lower, upper = (_ends(sums, ends[:, k], seen, f) for k, f in enumerate((end_face.LOWER, end_face.UPPER)))
    return RawFaces(faces, _face_lines(sums[:, end_face.WHOLE], seen), lower, upper, seen, side, sense, labels)


def middle_of(cloud: Cloud, face: FaceLines) -> Float:
    """A face's centroid in the base (N, 3), mm; NaN where it is not seen."""
    pose = cloud.base_from_profiler
    return np.asarray(pose[:, :3, 3] + face.x_mean[:, None] * pose[:, :3, 0] + face.z_mean[:, None] * pose[:, :3, 2])


def outward_of(cloud: Cloud, found: RawFaces) -> Float:
    """The direction (N, 3) in each laser plane square to the end face, out of the plate; NaN where it is not seen."""
    face = found.faces[ROOT_FACE]
    slope = (face.sxz / face.sxx)[:, None]
    x, z = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    return np.asarray(found.sense * (slope * x - z) / np.hypot(1.0, slope))


def _face_lines(sums: Float, seen: Bool) -> FaceLines:
    """The kernel's sums (N, 8) of one face as FaceLines."""
    here = seen & (sums[:, end_face.COUNT] >= 3)
    value = np.where(here[:, None], sums, np.nan)
    columns = np.where(here[:, None], sums[:, [end_face.FIRST, end_face.LAST]], -1).astype(np.int64)
    count = np.where(here, sums[:, end_face.COUNT], 0).astype(np.int64)
    return FaceLines(
        count,
        value[:, end_face.X_MEAN],
        value[:, end_face.Z_MEAN],
        value[:, end_face.SXX],
        value[:, end_face.SXZ],
        value[:, end_face.SZZ],
        columns,
    )


def _ends(sums: Float, ends: Float, seen: Bool, surface: int) -> FaceEnds:
    """One end of the face: the crossing with its surface where that is seen, else the last return."""
    kind = np.where(seen, ends[:, end_face.KIND], end_face.HIDDEN)
    corner = kind == end_face.CORNER
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = sums[:, :, end_face.SXZ] / sums[:, :, end_face.SXX]
        offset = sums[:, :, end_face.Z_MEAN] - slope * sums[:, :, end_face.X_MEAN]
        x = (offset[:, surface] - offset[:, end_face.FACE]) / (slope[:, end_face.FACE] - slope[:, surface])
        crossing = np.stack([x, slope[:, end_face.FACE] * x + offset[:, end_face.FACE]], axis=1)
    point = np.where(corner[:, None], crossing, ends[:, [end_face.END_X, end_face.END_Z]])
    point[kind == end_face.HIDDEN] = np.nan
    pitch = np.where(corner, 0.0, ends[:, end_face.PITCH])
    burred = seen & (ends[:, end_face.PROUD] >= BURR_POINTS)
    return FaceEnds(
        corner, point, ends[:, end_face.COLUMN], pitch, ends[:, end_face.SLOPE], ends[:, end_face.ALONE] == 1.0, burred
    )
