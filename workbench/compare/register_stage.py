"""`compare.register`: a scan laid on a reference, point to plane: Open3D's ICP from coarse to fine, then Gauss-Newton.

Chen and Medioni, "Object modelling by registration of multiple range images", Image and Vision Computing 10, 1992;
directions that the shapes leave open as in Gelfand and others, "Geometrically stable sampling for the ICP algorithm",
3DIM 2003.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import Document
from workbench.children import in_one_thread
from workbench.compare.local_planes import SAME_SIDE, Surfels, Target, surfels, target_of
from workbench.compare.surface_stage import Registration, Surface, rigid
from workbench.errors import InputError
from workbench.geometry.coarse import coarse_registration, fine_registration
from workbench.geometry.medians import robust_sd
from workbench.geometry.poses import inverse, mapped, pose_from, rotation_from_vector, vector_from_rotation
from workbench.result_files import result_file
from workbench.stage import stage
from workbench.units import Bool, Float, Int, Shaped

OPEN = 2e-3  # mean square of the motion along the normals, per mm of motion: below, a direction is open
STEPS = 30
TUKEY = 4.685  # cut-off of the biweight in standard deviations
LEAST_SIGMA_MM = 1e-4
LEAST_PLACES = 30
COARSE_SPACINGS = 2.0  # voxel of the features, in spacings of the places
MOST_PLACES = 20_000  # that a mesh is sampled at


class Equations(NamedTuple):
    """Point-to-plane equations at one pose: n rows that count. Unknowns: shift (mm), turn times `lever_mm` (mm)."""

    use: Shaped[Bool, " c"]  # which places of the scan they belong to
    off_mm: Shaped[Float, "n 3"]  # those places, less the pivot
    frame: Shaped[Int, " n"] | None  # theirs; None: not known
    rows: Shaped[Float, "n 6"]
    residual_mm: Shaped[Float, " n"]
    weight: Shaped[Float, " n"]  # of the robust kernel
    pivot_mm: Shaped[Float, " 3"]
    lever_mm: float

    @property
    def information(self) -> Float:
        """Mean normal matrix (6, 6): squared motion along the normals for each mm of motion."""
        return np.asarray((self.rows * self.weight[:, None]).T @ self.rows / max(float(self.weight.sum()), 1e-9))

    def directions(self) -> tuple[Float, Float]:
        """Eigenvalues (6,), rising, and eigenvectors (6, 6) as columns."""
        size, vectors = np.linalg.eigh(self.information)
        return size, vectors


def coarse(source: Surfels, target: Surfels, initial: Float, reach_mm: float) -> Float:
    """Open3D's point-to-plane ICP of the flat places with Tukey's kernel."""
    places = source.centre_mm[source.flat], target.centre_mm[target.flat]
    return fine_registration(*places, initial, reach_mm, target.normal[target.flat], robust=True).target_from_source


def refine(
    source: Surfels, target: Target, pose: Float, initial: Float, reach_mm: float, hold: bool
) -> tuple[Float, Equations]:
    """The pose of least weighted squares and the equations there; with `hold`, open directions stay as in `initial`."""
    equations = equations_at(source, target, pose, reach_mm)
    if hold:
        pose = _without_open_motion(equations, pose, initial)
    for _ in range(STEPS):
        equations = equations_at(source, target, pose, reach_mm)
        size, vectors = equations.directions()
        gradient = (equations.rows * equations.weight[:, None]).T @ equations.residual_mm
        known = size > OPEN if hold else size > 1e-12
        step = -vectors[:, known] @ ((vectors.T @ gradient)[known] / (size[known] * equations.weight.sum()))
        pose = moved(equations, step) @ pose
        if np.abs(step).max() < 1e-8:
            break
    return pose, equations


def equations_at(source: Surfels, target: Target, pose: Float, reach_mm: float) -> Equations:
    """Equations of the flat places of a scan that find a place with the same normal within reach."""
    points, normals = mapped(pose, source.centre_mm), source.normal @ pose[:3, :3].T
    foot, normal = target(points)
    height = ((points - foot) * normal).sum(axis=1)
    with np.errstate(invalid="ignore"):
        use = source.flat & (np.abs(height) < reach_mm) & ((normals * normal).sum(axis=1) > SAME_SIDE)
    points, normal, height = points[use], normal[use], height[use]
    pivot = points.mean(axis=0) if len(points) else np.zeros(3)
    off = points - pivot
    lever = float(np.sqrt((off**2).sum() / max(len(off), 1))) or 1.0
    middle = np.median(height) if len(height) else 0.0
    sigma = max(robust_sd(height - middle) if len(height) else 0.0, LEAST_SIGMA_MM)
    spread = max(sigma, abs(float(middle)))  # far from the end all residuals are of one sign
    weight = np.maximum(1.0 - (height / (TUKEY * spread)) ** 2, 0.0) ** 2
    frame = None if source.frame is None else source.frame[use]
    return Equations(use, off, frame, np.hstack([normal, np.cross(off, normal) / lever]), height, weight, pivot, lever)


def moved(equations: Equations, step: Float) -> Float:
    """The small motion (4, 4) that unknowns (6,) stand for: a turn about the pivot, then a shift."""
    turn = rotation_from_vector(step[3:] / equations.lever_mm)
    return pose_from(turn, equations.pivot_mm - turn @ equations.pivot_mm + step[:3])


def _without_open_motion(equations: Equations, pose: Float, initial: Float) -> Float:
    """`pose`, less what it moves away from `initial` in open directions."""
    size, vectors = equations.directions()
    motion = pose @ inverse(initial)
    turn = vector_from_rotation(motion[:3, :3])
    shift = mapped(motion, equations.pivot_mm) - equations.pivot_mm
    step = np.r_[shift, turn * equations.lever_mm]
    known = vectors[:, size > OPEN]
    return moved(equations, known @ (known.T @ step)) @ initial


@stage("compare.register")
def register(
    scan: Surface,
    reference: Surface,
    *,
    initial: list[list[float]] | None = None,
    start: Literal["initial", "features"] = "initial",
    open_directions: Literal["refuse", "hold"] = "refuse",
    held_u_mm: Annotated[float, Field(gt=0, le=100)] = 0.5,
    reach_mm: Annotated[float, Field(gt=0, le=50)] = 1.0,
    spacing_mm: Annotated[float, Field(ge=1e-3, le=20)] = 0.8,
    radius_mm: Annotated[float, Field(gt=0, le=20)] = 0.8,
    least_overlap: Annotated[float, Field(gt=0, le=1)] = 0.5,
    largest_rms_mm: Annotated[float, Field(gt=0, le=10)] = 0.15,
) -> tuple[Registration, Document]:
    """Register a scan to another scan, a mesh or a plan: point-to-plane ICP (Open3D), robust.

    Open directions (a straight edge slides along itself) are named, and refused or held (docs/comparison.md).

    Args:
        scan: from `compare.surface`.
        reference: from `compare.surface`, `compare.mesh` or `compare.plan`.
        initial: 4x4 (direction cosines, mm) reference_from_scan to start from; null: both in the base.
        start: the initial pose, or one found by features and RANSAC (`initial` must be null).
        open_directions: refuse them, or hold the initial pose there.
        held_u_mm: standard uncertainty of the initial pose in held directions.
        reach_mm: largest distance of corresponding places at the end.
        spacing_mm: between the places that are matched.
        radius_mm: of the neighbourhood that makes a local plane.
        least_overlap: least share of the scan on the reference.
        largest_rms_mm: largest rms distance along the normal.

    Raises:
        InputError: open directions, a small overlap, a poor fit.

    Example:
        >>> from workbench import compare, scan
        >>> first = scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5"))
        >>> again = scan.fuse(scan.read(recording="data/synthetic/milled_edge_again.h5"))
        >>> surfaces = [compare.surface(points) for points in (again, first)]
        >>> found, document = compare.register(*surfaces, open_directions="hold", spacing_mm=2.0)
        >>> round(found.overlap, 1), len(found.held)
        (1.0, 1)
    """
    pose = np.eye(4) if initial is None else rigid(initial, "compare.register.initial")
    if start == "features" and (initial is not None or open_directions == "hold"):
        raise InputError(
            "compare.register.start",
            "expected no initial pose, and open_directions 'refuse', with 'features': nothing is known to hold on to",
        )
    source = surfels(scan, spacing_mm, radius_mm)
    coarse_target = _sampled(reference, spacing_mm, radius_mm)
    _check_flat(scan, source, radius_mm)
    _check_flat(reference, coarse_target, radius_mm)
    starts = [pose]
    if start == "features":
        places, voxel_mm = coarse_target.centre_mm, COARSE_SPACINGS * spacing_mm
        found_starts = in_one_thread(coarse_registration, scan.points_mm, places, voxel_mm)
        starts = [one.target_from_source for one in found_starts]
    found_poses = [coarse(source, coarse_target, one, reach_mm) for one in starts]
    target = target_of(reference, spacing_mm, radius_mm)
    found_pose = max(found_poses, key=lambda one: int(equations_at(source, target, one, reach_mm).use.sum()))
    pose, equations = refine(source, target, found_pose, pose, reach_mm, open_directions == "hold")
    overlap = float(equations.use.sum() / max(int(source.flat.sum()), 1))
    rms = float(np.sqrt(np.average(equations.residual_mm**2, weights=equations.weight))) if overlap else math.nan
    _check(scan, reference, equations, overlap, rms, least_overlap, largest_rms_mm)
    size, vectors = equations.directions()
    loose = [in_words(vectors[:, k], equations, scan) for k in np.flatnonzero(size <= OPEN)]
    if loose and open_directions == "refuse":
        raise InputError(
            scan.source or "compare.register",
            f"the shapes leave open: {'; '.join(loose)}: expected "
            "shapes that fix it, or open_directions 'hold' to keep the initial pose there",
        )
    kept = tuple(f"kept as in the initial pose, not determined: {one}" for one in loose)
    found = Registration(
        pose,
        covariance_of(equations, held_u_mm),
        equations.pivot_mm,
        overlap,
        rms,
        tuple(loose),
        len(equations.weight),
        (*scan.warnings, *reference.warnings, *kept),
    )
    return found, _document(found, scan, reference)


def _sampled(reference: Surface, spacing_mm: float, radius_mm: float) -> Surfels:
    """Local planes of a reference; of a mesh, points on it with their normals."""
    if reference.triangles is None:
        return surfels(reference, spacing_mm, radius_mm)
    import open3d

    o3d: Any = open3d
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(reference.points_mm),
        o3d.utility.Vector3iVector(reference.triangles.astype(np.int32)),
    )
    o3d.utility.random.seed(0)
    count = int(np.clip(mesh.get_surface_area() / spacing_mm**2, 1000, MOST_PLACES))
    made = mesh.sample_points_uniformly(count, use_triangle_normal=True)
    return Surfels(np.array(made.points), np.array(made.normals), np.ones(count, bool))


def _check_flat(surface: Surface, places: Surfels, radius_mm: float) -> None:
    flat = int(places.flat.sum())
    if flat < LEAST_PLACES:
        raise InputError(
            surface.source or "compare.register",
            f"only {flat} of {len(places.flat)} places are flat "
            f"within {radius_mm:g} mm: expected {LEAST_PLACES}, or a larger radius_mm",
        )


def _check(
    scan: Surface,
    reference: Surface,
    equations: Equations,
    overlap: float,
    rms_mm: float,
    least: float,
    most_mm: float,
) -> None:
    where = scan.source or "compare.register"
    if equations.use.sum() < LEAST_PLACES or overlap < least:
        long = [float(np.ptp(one.points_mm, axis=0).max()) for one in (scan, reference)]
        raise InputError(
            where,
            f"only {100 * overlap:.0f} % of the scan lies on the reference ({equations.use.sum()} "
            f"places), expected at least {100 * least:.0f} %: another part or unit, a mesh turned inside out, or too "
            f"far off to start? They are {long[0]:.3g} and {long[1]:.3g} mm long",
        )
    if rms_mm > most_mm:
        raise InputError(
            where, f"the scan does not fit the reference: RMS distance {rms_mm:.3f} mm, expected at most {most_mm:g} mm"
        )


def _document(found: Registration, scan: Surface, reference: Surface) -> Document:
    content = {
        "part": asdict(scan.part),
        "scan": scan.source,
        "reference": reference.source,
        "reference_from_scan": found.reference_from_scan,
        "pivot_mm": found.pivot_mm,
        "covariance": found.covariance,
        "overlap": found.overlap,
        "rms_mm": found.rms_mm,
        "places": found.points,
        "held": list(found.held),
        "warnings": list(found.warnings),
    }
    return result_file("registration.json", content)


# Directions that a registration leaves open, in words.

ALONG = 15.0  # degrees from the longest direction within which a slide is one along the edge


def in_words(direction: Float, equations: Equations, scan: Surface) -> str:
    """What a motion (6,), shift and turn times the lever, does: slide, turn, or both."""
    shift, turn = direction[:3], direction[3:]
    long = np.linalg.svd(
        scan.points_mm[:: max(1, len(scan.points_mm) // 2000)] - scan.points_mm.mean(axis=0), full_matrices=False
    )[2][0]
    if np.linalg.norm(shift) >= np.linalg.norm(turn):
        unit = shift / np.linalg.norm(shift)
        edge = " along the edge" if abs(unit @ long) > math.cos(math.radians(ALONG)) else ""
        return f"sliding{edge} by ({_numbers(unit)})"
    unit = turn / np.linalg.norm(turn)
    return f"turning about ({_numbers(unit)}) through ({', '.join(f'{x:.0f}' for x in equations.pivot_mm)}) mm"


def _numbers(unit: Float) -> str:
    return ", ".join(f"{x + 0.0:.2f}" for x in (unit * np.sign(unit[np.argmax(np.abs(unit))])).round(2))


# Covariance of a registration: its normal equations, and residuals that hang together.

LEAST_STRETCHES, STRETCH_MM = 12, 4.0  # residuals of one stretch hang together


def covariance_of(equations: Equations, held_u_mm: float) -> Float:
    """(6, 6) of the shift (mm) and the turn (rad) about the pivot.

    H^-1 V H^-1 with V the variance of the sum of weighted rows times residuals (Huber, Robust Statistics, 1981). A
    residual has an error of its own, and shares with its stretch of the part a displacement in space: robot errors of
    frames, and neighbourhoods that overlap. Open directions get the initial pose's uncertainty instead.
    """
    size, vectors = equations.directions()
    stretch = stretches(equations)
    own, shared = components(equations, stretch)
    rows = (equations.rows * equations.weight[:, None]) @ vectors
    together = np.zeros((int(stretch.max()) + 1, 3, 6))
    for axis in range(3):
        np.add.at(together[:, axis], stretch, rows * equations.rows[:, axis : axis + 1])
    sums = together.reshape(-1, 6)
    variance = own * rows.T @ rows + shared * sums.T @ sums
    known = size > OPEN
    scale = 1.0 / np.maximum(size * equations.weight.sum() * _efficiency(equations), 1e-300) * known
    inside = scale[:, None] * variance * scale
    inside[~known, ~known] = held_u_mm**2
    unit = np.r_[np.ones(3), np.full(3, 1.0 / equations.lever_mm)]
    return np.asarray(unit[:, None] * (vectors @ inside @ vectors.T) * unit)


def components(equations: Equations, stretch: Int) -> tuple[float, float]:
    """Variances (mm^2) of a residual's own error and of each coordinate of its stretch's displacement.

    By moments: sums of squares of residuals, and of their sums along the normals over stretches; both made larger for
    the six parameters that the fit has taken out of the stretches.
    """
    residual, normal = equations.residual_mm * np.sqrt(equations.weight), equations.rows[:, :3]
    count = int(stretch.max()) + 1
    sums, moments = np.zeros((count, 3)), np.zeros((count, 3, 3))
    np.add.at(sums, stretch, normal * residual[:, None])
    np.add.at(moments, stretch, normal[:, :, None] * normal[:, None, :])
    total, spread = float((residual**2).sum()), float((moments**2).sum())
    filled = len(np.unique(stretch))
    excess = float((sums**2).sum()) * filled / max(filled - 3.0, 1.0) - total
    shared = max(0.0, excess / max(spread - len(residual), 1.0))
    return max(total / len(residual) - shared, 0.0), shared


def stretches(equations: Equations) -> Int:
    """The stretch (n,) of every row: equally many frames where they are known, else equal lengths; about STRETCH_MM."""
    along = equations.off_mm @ np.linalg.svd(equations.off_mm, full_matrices=False)[2][0]
    count = max(LEAST_STRETCHES, int(np.ptp(along) / STRETCH_MM))
    if equations.frame is not None:
        along = equations.frame.astype(float)
    number: Int = ((along - along.min()) / (float(np.ptp(along)) or 1.0) * count).astype(np.int64)
    return np.minimum(number, count - 1)


def _efficiency(equations: Equations) -> float:
    """Mean slope of the biweight's influence over its mean weight: an M-estimator's own normal matrix (Huber 1981)."""
    root = np.sqrt(np.clip(equations.weight, 0.0, 1.0))
    slope = root * (5.0 * root - 4.0)
    return float(np.clip(slope.mean() / max(equations.weight.mean(), 1e-9), 0.5, 1.0))
