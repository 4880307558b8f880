"""Deviations of a registered scan from a reference at evenly spread places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.compare.course import Course
from workbench.compare.m3c2 import DETECTION, heights
from workbench.compare.surface_values import Deviations, Registration, Surface
from workbench.compare.surfels import Surfels, surfels
from workbench.compare.target import on_mesh
from workbench.units import Float


@dataclass(frozen=True, slots=True)
class Scales:
    """Of the comparison: between places; diameters of a normal's neighbourhood and of a cylinder; its reach."""

    spacing_mm: float
    normal_mm: float
    projection_mm: float
    depth_mm: float


def places_of(scan: Surface, reference: Surface, scales: Scales) -> Surfels:
    """Flat places of the scan; their normals point outwards as the reference's do where it is a mesh."""
    found = surfels(scan, scales.spacing_mm, 0.5 * scales.normal_mm)
    centre, normal = found.centre_mm[found.flat], found.normal[found.flat]
    if reference.triangles is not None and len(centre):
        turned = (on_mesh(reference)(centre)[1] * normal).sum(axis=1) < 0
        normal = np.where(turned[:, None], -normal, normal)
    return Surfels(centre, normal, np.ones(len(centre), bool))


def deviations(
    scan: Surface,
    reference: Surface,
    places: Surfels,
    registration: Registration | None,
    position_u_mm: float,
    course: Course,
    scales: Scales,
) -> Deviations:
    """M3C2 distances at places of a registered scan; NaN where one of the surfaces is missing."""
    position, normal, radius = places.centre_mm, places.normal, 0.5 * scales.projection_mm
    depth_mm = scales.depth_mm
    if reference.triangles is None:
        mine = heights(scan.points_mm, None, scan.frame, position, normal, radius, depth_mm)
        other = heights(reference.points_mm, None, reference.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm - other.height_mm, np.hypot(mine.u_mm, other.u_mm)
    else:
        foot, outward = on_mesh(reference)(scan.points_mm)
        off = ((scan.points_mm - foot) * outward).sum(axis=1)
        off[np.abs(off) > depth_mm] = np.nan
        mine = heights(scan.points_mm, off, scan.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm, mine.u_mm
    u = np.hypot(noise, position_u(registration, position, normal, position_u_mm))
    along, aside = course.locate(position)
    return Deviations(position, normal, distance, u, DETECTION * u, along, aside)


def position_u(registration: Registration | None, position_mm: Float, normal: Float, position_u_mm: float) -> Float:
    """(c,) what the registration's covariance makes along each normal; without one, the uncertainty that is stated."""
    if registration is None:
        return np.full(len(position_mm), position_u_mm)
    rows = np.hstack([normal, np.cross(position_mm - registration.pivot_mm, normal)])
    return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", rows, registration.covariance, rows)))
