"""The root size of every frame: from its corner with the bevel face to the lower end of the root face."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, Cloud
from workbench.edge.directions import smooth_along, wrapped
from workbench.edge.faces import TrackedFaces
from workbench.geometry.curves import Curve
from workbench.geometry.ends import Ends, contradicted, fit_end, local_end
from workbench.geometry.sections import SectionLines, crossing, in_section, section_lines
from workbench.units import Bool, Float, Int

SLOPE_MM = 15.0  # the root size's drift is taken over this much edge on each side: nearer, it is the columns' steps
MIXED = 0.5  # probability that a mixed pixel stands in the place of the face's last return


def root_size(cloud: Cloud, tracked: TrackedFaces, curve: Curve, root: SectionLines, bevel: SectionLines, tilt: Float,
               beta: Float, up: Float, lower_slope: Float) -> tuple[Float, Float, Float]:  # fmt: skip
    """Root size to the last return on the root face (N,), the step to the next column, and its standard deviation, mm.

    Where the lower surface is seen, the size is that to the corner with it, and the step 0.
    """
    pose = cloud.base_from_profiler[:, :3]
    end = tracked.root_end
    point = pose[:, :, 3] + end[:, :1] * pose[:, :, 0] + end[:, 1:2] * pose[:, :, 2]
    place = np.full((len(end), 2), np.nan)
    seen = np.isfinite(root.s) & np.isfinite(end[:, 0])
    _, place[seen] = in_section(point[seen], curve, root.s[seen])
    m = np.stack([np.cos(tilt), np.sin(tilt)], axis=1)
    n = np.stack([-np.sin(tilt), np.cos(tilt)], axis=1)
    ray_m, ray_n = (root.ray * m).sum(axis=1), (root.ray * n).sum(axis=1)
    slide = ((root.place - place) * n).sum(axis=1) / ray_n  # along the ray onto the line of all the face's points
    down = ((place - root.place) * m).sum(axis=1) + slide * ray_m
    step = end[:, 2] / np.hypot(1.0, root.run)
    down[tracked.end_is_cut | tracked.end_is_burred] = np.nan
    root_share = (1.0 / np.tan(beta) + ray_m / ray_n) ** 2
    if tracked.end_is_corner.any():
        corner, lean = _lower_corner(cloud, tracked, curve, root, tilt, lower_slope)
        at_corner = tracked.end_is_corner & np.isfinite(corner)
        down, step = np.where(at_corner, corner, down), np.where(at_corner, 0.0, step)
        root_share = np.where(at_corner, (1.0 / np.tan(beta) - 1.0 / np.tan(lean)) ** 2, root_share)
    variance = root_share * root.offset_variance + bevel.offset_variance / np.sin(beta) ** 2
    return up - down, step, np.sqrt(variance)


def _lower_corner(cloud: Cloud, tracked: TrackedFaces, curve: Curve, root: SectionLines, tilt: Float,
                  slope: Float) -> tuple[Float, Float]:  # fmt: skip
    """Distance along the root face to the corner with the lower surface (N,), mm; and the angle between both, rad."""
    lower = section_lines(tracked.faces[LOWER_SURFACE], slope, cloud.base_from_profiler, tracked.side,
                          tracked.range_sigma_mm[:, 3], curve, root.s)  # fmt: skip
    apparent = wrapped(lower.angle - tilt)
    lean, _ = smooth_along(lower.s, apparent, 1.0 / lower.angle_variance, cloud.pass_index)
    return crossing(root.place, tilt, lower.place, tilt + lean), lean


def missing_share(tracked: TrackedFaces, pass_index: Int) -> Float:
    """Probability that a column of the root face has no return on it (N,).

    The share inside the face, one value a pass; at the end of the face MIXED where the next column saw a mixed pixel,
    which may have taken the place of the face's last return as well as of the first one behind it.
    """
    root = tracked.faces[ROOT_FACE]
    share = np.full(root.count.shape, np.nan)
    for p in np.unique(pass_index):
        mine = (pass_index == p) & (root.count > 2)
        inner = (root.columns[mine, 1] - root.columns[mine, 0] - 1).sum()
        if inner > 0:
            share[pass_index == p] = 1.0 - (root.count[mine] - 2).sum() / inner
    return np.where(tracked.end_is_mixed, MIXED, np.clip(share, 0.02, 0.6))


def smooth_size(s: Float, low: Float, step: Float, sigma: Float, missing: Float, counts: Float,
                burred: Bool) -> tuple[Float, Float]:  # fmt: skip
    """Root size and its slope along the edge at each frame (N,), all passes together.

    Where a burr covers the root face's end (burred) the size is that of the course between its neighbours.
    """
    size, slope = np.full(s.shape, np.nan), np.full(s.shape, np.nan)
    mine = np.flatnonzero(np.isfinite(s) & np.isfinite(low) & np.isfinite(sigma))
    mine = mine[np.argsort(s[mine], kind="stable")]
    ends = Ends(s[mine], low[mine], step[mine], sigma[mine], missing[mine], counts[mine])
    end = fit_end(ends)
    course = end.spline(s[mine])
    off_course = contradicted(ends, course, s[mine])
    course[off_course], _ = local_end(ends, s[mine][off_course])
    size[mine] = course
    bridged = np.flatnonzero(burred & (s > s[mine[0]]) & (s < s[mine[-1]]))
    size[bridged], slope[bridged] = end.spline(s[bridged]), 0.0
    ahead, behind = np.minimum(s[mine] + SLOPE_MM, s[mine[-1]]), np.maximum(s[mine] - SLOPE_MM, s[mine[0]])
    slope[mine] = (end.spline(ahead) - end.spline(behind)) / np.maximum(ahead - behind, 1e-6)
    return size, slope
