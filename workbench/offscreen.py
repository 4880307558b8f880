"""A process of its own for VTK: where a system's OpenGL is missing, VTK ends the process that it runs in.

(A segmentation fault with libegl1 absent, seen with VTK 9.7.) No exception handler survives that; so the process that
draws must not be the one that does the work.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys

from workbench.children import environment

TIME_LIMIT_S = 120.0
LIBRARIES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1"}  # what VTK loads -> its package in Debian


def start_drawing(module: str, arguments: list[str], folder: str) -> subprocess.Popen[bytes]:
    """`python -m module arguments` at work in `folder`, with this project's own copy, from whatever directory."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def problem_of(process: subprocess.Popen[bytes]) -> str:
    """Waits for the process: '' where it ended well, else what went wrong."""
    try:
        _, messages = process.communicate(timeout=TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f"drawing took more than {TIME_LIMIT_S:.0f} s"
    if process.returncode == 0:
        return ""
    if process.returncode < 0:
        return f"its process was ended by signal {-process.returncode}"
    lines = messages.decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else f"its process ended with status {process.returncode}"


def cause_of(problem: str) -> str:
    """The missing system libraries and how to get them, if that is what it was; else `problem`."""
    missing = {library: package for library, package in LIBRARIES.items() if not _loads(library)}
    if not missing:
        return problem
    return f"missing {' and '.join(missing)}; on Debian or Ubuntu: apt-get install {' '.join(missing.values())}"


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
