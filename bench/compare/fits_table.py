"""Fits beside those of Open3D, scikit-image and scipy on known answers: `python -m bench.compare.fits_table`.

Prints docs/tables/comparison_fits.csv: the largest error, as a share of the shape's size, over 40 draws.
"""

from __future__ import annotations

import csv
import sys
import warnings
from collections.abc import Callable

import numpy as np
import open3d as o3d
from scipy.optimize import least_squares
from skimage.measure import CircleModel, LineModelND

from bench.compare.known_fits import Known, known
from workbench.geometry.fits import Shape, fit
from workbench.units import Float

DRAWS = 40
CASES: tuple[tuple[str, float, bool], ...] = (
    ("full", 360.0, False),
    ("arc of 30°", 30.0, False),
    ("full with the origin at 1e6 mm", 360.0, True),
)
Answer = tuple[Float, Float | None, float | None]  # point, direction, radius


def ours(shape: Shape, points: Float) -> Answer:
    found = fit(shape, points)
    return found.point_mm, found.direction, found.radius_mm


def scipy_fit(shape: Shape, points: Float) -> Answer:
    """`least_squares` with its own settings and numerical Jacobian, on the distances, from the known kind of start."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    axis = {"line": axes[0], "plane": axes[2], "circle": axes[2], "cylinder": axes[0]}.get(shape, np.zeros(3))
    size = float(np.linalg.norm(points - middle, axis=1).max())

    def distances(p: Float) -> Float:
        off, a = points - p[:3], p[4:] / max(float(np.linalg.norm(p[4:])), 1e-12)
        along = off @ a
        if shape == "sphere":
            return np.asarray(np.linalg.norm(off, axis=1) - p[3])
        if shape == "plane":
            return np.asarray(along)
        aside = off - np.outer(along, a)
        if shape == "line":
            return np.asarray(aside.ravel())
        radial = np.linalg.norm(aside, axis=1) - p[3]
        return np.asarray(np.r_[radial, along] if shape == "circle" else radial)

    p = least_squares(distances, np.r_[middle, size, axis]).x
    direction = None if shape == "sphere" else p[4:] / np.linalg.norm(p[4:])
    return p[:3], direction, p[3] if shape in ("circle", "sphere", "cylinder") else None


def skimage_line(shape: Shape, points: Float) -> Answer:
    model = LineModelND.from_estimate(points)
    return model.origin, model.direction, None


def skimage_circle(shape: Shape, points: Float) -> Answer:
    """A circle in the plane only: points turned into their principal plane first."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    model = CircleModel.from_estimate((points - middle) @ axes[:2].T)
    return middle + np.asarray(model.center) @ axes[:2], axes[2], float(model.radius)


def open3d_plane(shape: Shape, points: Float) -> Answer:
    """`segment_plane` with every point an inlier: its last step is a least-squares plane."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    size = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    plane, _ = cloud.segment_plane(size, 3, 100)
    normal = np.array(plane[:3])
    middle = points.mean(axis=0)
    return middle - normal * (normal @ middle + plane[3]) / (normal @ normal), normal / np.linalg.norm(normal), None


FITS: tuple[tuple[str, Shape, Callable[[Shape, Float], Answer]], ...] = (
    *(("workbench", shape, ours) for shape in ("line", "plane", "circle", "sphere", "cylinder")),
    *(("scipy least_squares", shape, scipy_fit) for shape in ("line", "plane", "circle", "sphere", "cylinder")),
    ("scikit-image LineModelND", "line", skimage_line),
    ("scikit-image CircleModel", "circle", skimage_circle),
    ("Open3D segment_plane", "plane", open3d_plane),
)  # type: ignore[assignment]


def error(shape: Shape, case: Known, answer: Answer) -> float:
    point, direction, radius = answer
    off = (point - case.centre_mm) / case.size_mm
    errors = [] if radius is None else [abs(abs(radius) / case.size_mm - 1)]
    if direction is not None:
        errors.append(float(np.linalg.norm(np.cross(direction, case.axis))))
    if shape in ("circle", "sphere"):
        errors.append(float(np.linalg.norm(off)))
    else:
        errors.append(
            abs(float(off @ case.axis)) if shape == "plane" else float(np.linalg.norm(np.cross(off, case.axis)))
        )
    return max(errors)


def main() -> None:
    warnings.simplefilter("ignore")
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["shape", "by", *(name for name, _, _ in CASES)])
    for name, shape, fitted in sorted(FITS, key=lambda row: (row[1], row[0] != "workbench")):
        cells = []
        for _, arc, far in CASES:
            if arc < 360 and shape in ("line", "plane"):
                cells.append("")
                continue
            errors = [
                error(shape, case, fitted(shape, case.points_mm))
                for case in (known(shape, seed, arc, far) for seed in range(DRAWS))
            ]
            cells.append(f"{max(errors):.0e}")
        table.writerow([shape, name, *cells])


if __name__ == "__main__":
    main()
