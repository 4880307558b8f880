"""Processes of readers and of registrations, forked from one that has loaded their libraries: Open3D takes a second.

They are processes of their own all the same, with the limits, the exit status and the words of `workbench.children`.
Where a test changes PYTHONPATH, and for xacro, which may load nothing more, the process is started as it is for a user.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import math
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

OPEN3D = ("numpy", "open3d")
LIBRARIES = {"readers.py": OPEN3D, "mesh_reader.py": OPEN3D, "cad.py": ("numpy", "gmsh")}
LIBRARIES["-m"] = (*OPEN3D, "workbench.cloud.register_stage", "workbench.compare.register_stage")


class Forked:
    """Stands for the module `subprocess` in `workbench.children`."""

    def __init__(self) -> None:
        self.path = os.environ.get("PYTHONPATH")
        self.server: Any = None

    def run(self, command: list[str], **how: Any) -> Any:
        reader = Path(command[2])
        if reader.name not in LIBRARIES or os.environ.get("PYTHONPATH") != self.path:
            return subprocess.run(command, **how)
        if self.server is None:
            self.server = subprocess.Popen(
                [sys.executable, "-P", __file__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=how["env"] | {"OMP_NUM_THREADS": "1"},
            )
        with tempfile.TemporaryDirectory() as own:
            folder = Path(how.get("cwd", own))
            told, said = folder / "told", folder / "said"
            told.write_bytes(how["input"])
            self.server.stdin.write(json.dumps([command[2:], str(folder), how.get("timeout")]) + "\n")
            self.server.stdin.flush()
            status = int(self.server.stdout.readline())
            if status == -signal.SIGALRM:
                raise subprocess.TimeoutExpired(command, how["timeout"])
            return subprocess.CompletedProcess(command, status, said.read_bytes(), b"")

    def end(self) -> None:
        if self.server is not None:
            self.server.communicate()


def serve() -> None:
    """Fork a process for each line of standard input, and write its exit status.

    On one core from the beginning: how many there are, a library asks when it is loaded.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    for line in sys.stdin:
        command, folder, seconds = json.loads(line)
        for name in LIBRARIES[Path(command[0]).name]:
            importlib.import_module(name)
        child = os.fork()
        if child == 0:
            signal.alarm(math.ceil(seconds or 0))
            os._exit(read(command, Path(folder)))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def read(command: list[str], folder: Path) -> int:
    """In the child: the reader as a script or as a module."""
    os.chdir(folder)
    for number, name, flags in ((0, "told", os.O_RDONLY), (1, "said", os.O_WRONLY | os.O_CREAT)):
        os.dup2(os.open(folder / name, flags), number)
    sys.argv, status = command, 0
    try:
        script = importlib.import_module(command[1]).__file__ if command[0] == "-m" else command[0]
        runpy.run_path(str(script), run_name="__main__")
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    ctypes.CDLL(None).fflush(None)  # what libraries said
    return status


if __name__ == "__main__":
    serve()
