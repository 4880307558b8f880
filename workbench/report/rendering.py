"""Has VTK draw the views in space, in a process of its own, and copes where it cannot.

Where a system's OpenGL is missing VTK ends the process that it runs in (a segmentation fault with libegl1 absent,
seen with VTK 9.7), which no exception handler survives; so that process must not be the one that writes the report.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from workbench.report.flat import flat
from workbench.report.scene import View

TIME_LIMIT_S = 120.0
LIBRARIES = {"libGL.so.1": "libgl1", "libEGL.so.1": "libegl1"}  # what VTK loads -> its package in Debian


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """The views as PNG bytes by name; `problem` says why VTK did not draw them, where it did not."""

    png: Mapping[str, bytes]
    problem: str = ""


class Rendering:
    """The drawing process at work: start it, do something else meanwhile, then take the pictures."""

    def __init__(self, views: Mapping[str, View]) -> None:
        self._views = views
        self._folder = tempfile.TemporaryDirectory(prefix="workbench-report-")
        self._process: subprocess.Popen[bytes] | None = None
        self._problem = ""
        for name, view in views.items():
            np.savez(Path(self._folder.name) / f"{name}.npz", **{f.name: getattr(view, f.name) for f in fields(view)})
        try:
            self._process = _start(self._folder.name, list(views))
        except OSError as error:
            self._problem = str(error)

    def pictures(self) -> Pictures:
        """Waits for the process: VTK's pictures, or matplotlib's and what VTK lacked, of which a warning tells."""
        with self._folder as folder:
            problem = self._problem or self._wait()
            drawn = {name: Path(folder) / f"{name}.png" for name in self._views}
            if not problem and all(path.exists() for path in drawn.values()):
                return Pictures({name: path.read_bytes() for name, path in drawn.items()})
        why = explained(problem)
        warnings.warn(why, RuntimeWarning, stacklevel=3)
        return Pictures({name: flat(view) for name, view in self._views.items()}, why)

    def _wait(self) -> str:
        """'' where the process ended well, else what went wrong."""
        assert self._process is not None
        try:
            _, messages = self._process.communicate(timeout=TIME_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
            return f"drawing took more than {TIME_LIMIT_S:.0f} s"
        if self._process.returncode == 0:
            return ""
        if self._process.returncode < 0:
            return f"its process was ended by signal {-self._process.returncode}"
        lines = messages.decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"its process ended with status {self._process.returncode}"


def explained(problem: str) -> str:
    """`problem` in one line that names the missing system libraries, if that is what it was."""
    missing = {library: package for library, package in LIBRARIES.items() if not _loads(library)}
    cause = problem
    if missing:
        cause = f"missing {' and '.join(missing)}; on Debian or Ubuntu: apt-get install {' '.join(missing.values())}"
    return f"The views in space are drawn in a simpler manner, because VTK could not start offscreen ({cause})."


def _start(folder: str, names: list[str]) -> subprocess.Popen[bytes]:
    """This project's own copy is drawn with, from whatever directory; `folder` is the working directory."""
    home = str(Path(__file__).resolve().parents[2])
    path = os.pathsep.join(each for each in (home, os.environ.get("PYTHONPATH")) if each)
    return subprocess.Popen(
        [sys.executable, "-m", "workbench.report.render", *names],
        cwd=folder,
        env=dict(os.environ, PYTHONPATH=path),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
