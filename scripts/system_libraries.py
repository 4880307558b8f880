"""Print the Debian/Ubuntu packages of shared libraries that the wheels need and this machine lacks, one a line.

Runs before anything is installed, on the plain Python of the machine: standard library only.
"""

import ctypes
import sys

# What open3d (the first six), numba and pin are linked against; vtk opens the first two when it draws.
PACKAGE_OF_LIBRARY = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libudev.so.1": "libudev1",
    "libidn2.so.0": "libidn2-0",
    "libgomp.so.1": "libgomp1",
}
OF_GMSH = {  # which the tests need, and users of [cad]: `system_libraries.py dev`
    "libGLU.so.1": "libglu1-mesa",
    "libOpenGL.so.0": "libopengl0",
    "libXft.so.2": "libxft2",
    "libXcursor.so.1": "libxcursor1",
    "libXinerama.so.1": "libxinerama1",
}


def loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


if __name__ == "__main__":
    wanted = PACKAGE_OF_LIBRARY | (OF_GMSH if sys.argv[1:] == ["dev"] else {})
    for library, package in wanted.items():
        if not loads(library):
            print(package)
