"""Import every compiled package and draw one triangle offscreen: what is missing shows itself here, in words.

The picture is drawn in a child process, since a library that VTK cannot open ends the process, not the Python in it.
"""

import importlib
import subprocess
import sys

COMPILED = ("numpy", "scipy.linalg", "numba", "h5py", "skimage.measure", "fcl", "pinocchio", "open3d", "vtk")
DRAW = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.add_mesh(pyvista.Triangle(), color="black")
assert plotter.screenshot(return_img=True).min() < 128
"""


def main() -> int:
    for name in COMPILED:
        try:
            importlib.import_module(name)
        except ImportError as error:
            print(f"setup: {name} cannot be imported: {error}", file=sys.stderr)
            return 1
    drawn = subprocess.run([sys.executable, "-c", DRAW], capture_output=True, text=True, check=False)
    if drawn.returncode != 0:
        last = (drawn.stderr.strip() or f"exit status {drawn.returncode}").splitlines()[-1]
        print(f"setup: VTK cannot draw offscreen: {last}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
