"""`compare.register`: a scan laid on a reference."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts import Document
from workbench.children import in_one_thread
from workbench.compare.icp import OPEN, Equations, coarse, equations_at, refine
from workbench.compare.surface import rigid
from workbench.compare.surface_values import Registration, Surface
from workbench.compare.surfels import Surfels, surfels, target_of
from workbench.errors import InputError
from workbench.geometry.coarse import coarse_registration
from workbench.stage import stage
from workbench.strict_json import strict_json
from workbench.units import Float, Int

LEAST_PLACES = 30
COARSE_SPACINGS = 2.0  # voxel of the features, in spacings of the places
MOST_PLACES = 20_000  # that a mesh is sampled at


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
    spacing_mm: Annotated[float, Field(gt=0, le=20)] = 0.8,
    radius_mm: Annotated[float, Field(gt=0, le=20)] = 0.8,
    least_overlap: Annotated[float, Field(gt=0, le=1)] = 0.5,
    largest_rms_mm: Annotated[float, Field(gt=0, le=10)] = 0.15,
) -> tuple[Registration, Document]:
    """Register a scan to another scan, a mesh or a plan: point-to-plane ICP (Open3D), coarse to fine, robust.

    The scan's local planes are matched with the reference's. Open directions (a straight edge slides along itself) are
    named, and refused or held (docs/comparison.md).

    Args:
        scan: from `compare.surface`.
        reference: from `compare.surface`, `compare.mesh` or `compare.plan`.
        initial: 4x4 (direction cosines, mm) reference_from_scan to start from; null: both are in the base.
        start: begin at the initial pose, or find a start by features and RANSAC (Open3D); `initial` must then be null.
        open_directions: where the shapes leave a direction open: refuse, or hold the initial pose.
        held_u_mm: standard uncertainty of the initial pose in held directions; it enters the covariance.
        reach_mm: largest distance of places that belong together, at the end; matches farther apart do not count.
        spacing_mm: between the places that are matched.
        radius_mm: of the neighbourhood that makes a local plane.
        least_overlap: share of the scan that must lie on the reference; a smaller one is refused.
        largest_rms_mm: of the distances along the normal; a larger one is refused.

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
    starts = _by_features(scan, coarse_target, COARSE_SPACINGS * spacing_mm) if start == "features" else [pose]
    found_poses = [coarse(source, coarse_target, one, reach_mm) for one in starts]
    target = target_of(reference, spacing_mm, radius_mm)
    found_pose = max(found_poses, key=lambda one: int(equations_at(source, target, one, reach_mm).use.sum()))
    pose, equations = refine(source, target, found_pose, pose, reach_mm, open_directions == "hold")
    overlap = _overlap(source, equations)
    rms = float(np.sqrt(np.average(equations.residual_mm**2, weights=equations.weight))) if overlap else math.nan
    _check(scan, equations, overlap, rms, least_overlap, largest_rms_mm)
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
        kept,
    )
    return found, _document(found, scan, reference)


def _by_features(scan: Surface, target: Surfels, voxel_mm: float) -> list[Float]:
    """Candidates for the start, from nothing."""
    return [
        one.target_from_source for one in in_one_thread(coarse_registration, scan.points_mm, target.centre_mm, voxel_mm)
    ]


def _sampled(reference: Surface, spacing_mm: float, radius_mm: float) -> Surfels:
    """Local planes of a reference; of a mesh, points on it with their normals."""
    if reference.triangles is None:
        return surfels(reference, spacing_mm, radius_mm)
    corners = reference.points_mm[reference.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    rng = np.random.default_rng(0)
    count = int(np.clip(area.sum() / spacing_mm**2, 1000, MOST_PLACES))
    chosen = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (corners[chosen, k] for k in range(3))
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    return Surfels(points, normal[chosen] / (2.0 * area[chosen, None]), np.ones(count, bool))


def _overlap(source: Surfels, equations: Equations) -> float:
    """Share of the scan's flat places that found their match."""
    return float(equations.use.sum() / max(int(source.flat.sum()), 1))


def _check_flat(surface: Surface, places: Surfels, radius_mm: float) -> None:
    flat = int(places.flat.sum())
    if flat < LEAST_PLACES:
        raise InputError(
            surface.source or "compare.register",
            f"only {flat} of {len(places.flat)} places are flat "
            f"within {radius_mm:g} mm: expected {LEAST_PLACES}, or a larger radius_mm",
        )


def _check(scan: Surface, equations: Equations, overlap: float, rms_mm: float, least: float, most_mm: float) -> None:
    where = scan.source or "compare.register"
    if equations.use.sum() < LEAST_PLACES or overlap < least:
        raise InputError(
            where,
            f"only {100 * overlap:.0f} % of the scan lies on the reference ({equations.use.sum()} "
            f"places), expected at least {100 * least:.0f} %: another part, or too far off to "
            "start",
        )
    if rms_mm > most_mm:
        raise InputError(
            where, f"the scan does not fit the reference: RMS distance {rms_mm:.3f} mm, expected at most {most_mm:g} mm"
        )


def _document(found: Registration, scan: Surface, reference: Surface) -> Document:
    content = {
        "format": "cloud-registration",
        "version": 1,
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
    return Document("registration.json", strict_json(content))


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
