"""Has VTK draw the views in space, in a process of its own (`workbench.offscreen`), and copes where it cannot."""

from __future__ import annotations

import subprocess
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from workbench.offscreen import cause_of, problem_of, start_drawing
from workbench.report.flat import flat
from workbench.report.scene import View


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
            self._process = start_drawing("workbench.report.render", list(views), self._folder.name)
        except OSError as error:
            self._problem = str(error)

    def pictures(self) -> Pictures:
        """Waits for the process: VTK's pictures, or matplotlib's and what VTK lacked, of which a warning tells."""
        with self._folder as folder:
            problem = problem_of(self._process) if self._process else self._problem
            drawn = {name: Path(folder) / f"{name}.png" for name in self._views}
            if not problem and all(path.exists() for path in drawn.values()):
                return Pictures({name: path.read_bytes() for name, path in drawn.items()})
        why = explained(problem)
        warnings.warn(why, RuntimeWarning, stacklevel=3)
        return Pictures({name: flat(view) for name, view in self._views.items()}, why)


def explained(problem: str) -> str:
    """`problem` in one line that names the missing system libraries, if that is what it was."""
    return (
        "The views in space are drawn in a simpler manner, because VTK could not start offscreen "
        f"({cause_of(problem)})."
    )
