"""Bevel angle and root face profile by profile, as a competent engineer would write it in an afternoon.

Least-squares lines z = a x + b through each face of each profile, outliers left out; the corner where they cross, the
root from there to its last return, the angle between the lines in the laser plane; the median over the frames near a
section. It is spared the hardest part: it is told which columns see which face.
"""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Recording
from workbench.units import DEG, Bool, Float, Int

TRIM_COLUMNS = 1  # left out at both ends of a face
LEAST_POINTS = 4
OUTLIER_SIGMAS = 3.5
ROUNDS = 4


def inspect(recording: Recording, root: Bool, bevel: Bool, near: list[Int]) -> tuple[Float, Float]:
    """Root face (mm) and bevel angle (deg) in m sections; NaN where no profile shows both faces.

    root, bevel (N, M): columns that see the face. near: numbers of the frames close to each section.
    """
    x, z = recording.x_mm.astype(float), recording.z_mm.astype(float)
    root_line, bevel_line = fit_lines(x, z, inner(root)), fit_lines(x, z, inner(bevel))
    with np.errstate(invalid="ignore", divide="ignore"):
        corner = (bevel_line[:, 1] - root_line[:, 1]) / (root_line[:, 0] - bevel_line[:, 0])
    length = np.hypot(1.0, root_line[:, 0]) * reach(x, z, root, root_line, corner)
    angle = np.abs(np.arctan(root_line[:, 0]) - np.arctan(bevel_line[:, 0])) / DEG
    return np.array([middle(length[f]) for f in near]), np.array([middle(angle[f]) for f in near])


def fit_lines(x: Float, z: Float, mask: Bool) -> Float:
    """Slope, offset and scatter (N, 3) of z = a x + b through the points of each profile in `mask`, without outliers.

    Starts from the median of slopes between points a third of the face apart, which a few outliers cannot move.
    """
    out = np.full((len(x), 3), np.nan)
    for i in range(len(x)):
        use = mask[i] & np.isfinite(z[i])
        xs, zs = x[i, use], z[i, use]
        if len(xs) < LEAST_POINTS:
            continue
        apart = max(1, len(xs) // 3)
        a = float(np.median((zs[apart:] - zs[:-apart]) / (xs[apart:] - xs[:-apart])))
        b = float(np.median(zs - a * xs))
        scatter = np.nan
        for _ in range(ROUNDS):
            off = zs - a * xs - b
            scatter = 1.4826 * float(np.median(np.abs(off))) + 1e-6
            kept = np.abs(off) < OUTLIER_SIGMAS * scatter
            if kept.sum() < 3:
                break
            mx, mz = xs[kept].mean(), zs[kept].mean()
            dx = xs[kept] - mx
            a = float(dx @ (zs[kept] - mz) / (dx @ dx))
            b = float(mz - a * mx)
        out[i] = a, b, scatter
    return out


def inner(face: Bool) -> Bool:
    """The columns of a face but for those next to its ends."""
    padded = np.pad(face, ((0, 0), (TRIM_COLUMNS, TRIM_COLUMNS)))
    return np.asarray(np.all([padded[:, k : k + face.shape[1]] for k in range(2 * TRIM_COLUMNS + 1)], axis=0))


def reach(x: Float, z: Float, root: Bool, line: Float, corner: Float) -> Float:
    """How far (N,) in x the returns on the root face's line reach from the corner."""
    with np.errstate(invalid="ignore"):
        on_line = np.abs(z - line[:, :1] * x - line[:, 1:2]) < OUTLIER_SIGMAS * line[:, 2:]
    away = np.where(root & on_line, np.abs(x - corner[:, None]), -np.inf).max(axis=1)
    return np.where(np.isfinite(away), away, np.nan)


def middle(values: Float) -> float:
    """The median of what was measured; NaN of nothing."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")
