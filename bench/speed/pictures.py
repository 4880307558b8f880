"""A picture of a big cloud: `geometry.splat` beside VTK, both on the processor, in a process of their own.

`python -m bench.speed.pictures FILE` prints points and medians as JSON. Both sides start from the same points and
colours in memory, in the order of the scan, and end with the pixels of the same parallel projection in memory.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from bench.speed.timing import in_turn
from workbench.geometry import grids
from workbench.geometry.splat import Camera, draw_cloud
from workbench.scan import fuse, read
from workbench.units import AnyArray, Float32

WIDTH_PX, HEIGHT_PX, REPEATS = 1600, 900, 3
LOOK, UP = np.array([-0.5, -0.8, 0.45]), np.array([0.0, 0.0, 1.0])


def points_of(path: Path) -> tuple[Float32, AnyArray]:
    """Points (n, 3) about their middle, in mm, and colours (n, 3) by height."""
    cloud = fuse(read(recording=path))
    centre = cloud.base_from_profiler[len(cloud.x_mm) // 2, :3, 3]
    points = grids.fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, centre)[cloud.keep]
    low, high = np.percentile(points[::1000, 2], (1.0, 99.0))
    shade = np.clip((points[:, 2] - low) / (high - low), 0.0, 1.0)
    return points, np.column_stack([80 + 120 * shade, 120 + 60 * shade, 200 - 60 * shade]).astype(np.uint8)


def camera_for(points_mm: Float32) -> Camera:
    """All points in the picture, seen from above and aside."""
    look = LOOK / np.linalg.norm(LOOK)
    right = np.cross(UP, look) / np.linalg.norm(np.cross(UP, look))
    screen = np.array([right, np.cross(look, right), look])
    seen = points_mm[::100] @ screen.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = 0.94 * min(WIDTH_PX / (high - low)[0], HEIGHT_PX / (high - low)[1])
    return Camera(screen, screen.T @ ((low + high) / 2.0), float(scale), WIDTH_PX, HEIGHT_PX)


def by_vtk(points_mm: Float32, colour: AnyArray, camera: Camera) -> AnyArray:
    """The same by VTK's own way of drawing points, on its offscreen window: (H, W, 3)."""
    import pyvista as pv

    plotter: Any = pv.Plotter(off_screen=True, window_size=[WIDTH_PX, HEIGHT_PX])
    cloud = pv.PolyData(points_mm)
    cloud["colour"] = colour
    plotter.set_background("white")
    plotter.add_mesh(cloud, scalars="colour", rgb=True, point_size=2.0, lighting=False, style="points")
    plotter.enable_parallel_projection()
    centre = camera.centre_mm
    plotter.camera_position = [tuple(centre + 1e4 * camera.screen[2]), tuple(centre), tuple(camera.screen[1])]
    plotter.camera.parallel_scale = 0.5 * HEIGHT_PX / camera.scale_px_mm
    plotter.reset_camera_clipping_range()
    pixels = plotter.screenshot(None, return_img=True)
    plotter.close()
    return np.asarray(pixels)


def measure(path: Path) -> dict[str, Any]:
    points, colour = points_of(path)
    camera = camera_for(points)
    ours_s, vtk_s = in_turn(
        lambda: draw_cloud(points, colour, camera), lambda: by_vtk(points, colour, camera), repeats=REPEATS
    )
    return {"points": len(points), "ours_s": ours_s, "vtk_s": vtk_s}


if __name__ == "__main__":
    json.dump(measure(Path(sys.argv[1])), sys.stdout)
