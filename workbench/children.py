"""Work that is done in a process of its own, by this copy of the package, from whatever directory."""

from __future__ import annotations

import importlib
import os
import pickle
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from workbench.errors import InputError, one_line
from workbench.extras import not_installed

T = TypeVar("T")
MEMORY, MEMORY_A_BYTE = 8 * 2**30, 64  # bytes that a reader may take
UNLOADABLE = 3  # exit status of a reader whose library cannot be loaded
MISSING = re.compile(r"(\S+\.so[.\d]*): cannot open shared object file")
HOME = Path(__file__).resolve().parents[1]


def environment(**more: str) -> dict[str, str]:
    """That of this process, with the package where a child finds it."""
    home = os.pathsep.join(each for each in (str(HOME), os.environ.get("PYTHONPATH")) if each)
    return {**os.environ, "PYTHONPATH": home, **more}


def library(name: str) -> Any:
    """A library, imported in a reader's process; where it cannot be, its words are said and the process ends so."""
    try:
        return importlib.import_module(name)
    except (ImportError, OSError) as error:  # OSError: a shared library, loaded by ctypes
        print(f"{name}: {one_line(str(error))}")
        sys.exit(UNLOADABLE)


def confine(size: int, seconds: int | None = None, output: int | None = None, memory: int = MEMORY) -> None:
    """In a reader's process: no core file, and no more memory and time than a file of so many bytes can ask for.

    Nor more bytes of `output`; `memory`: for a file of none.
    """
    try:
        import resource
    except ImportError:  # not on this system
        return
    limits = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_AS: memory + MEMORY_A_BYTE * size,
        resource.RLIMIT_CPU: seconds,
        resource.RLIMIT_FSIZE: output,
    }
    for what, most in limits.items():
        if most is not None:
            _, hard = resource.getrlimit(what)
            resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def refuse_unloadable(status: int, said: str) -> None:
    """Raise for a reader's process that ended because a library could not be loaded; the file is not to blame.

    Raises:
        InputError: with the library, and the shared library that is missing.
    """
    if status != UNLOADABLE:
        return
    name, _, why = (said.strip().splitlines() or ["a library: "])[-1].partition(": ")
    if missing := why.startswith("No module named") and not_installed(name):
        raise missing
    lacking = MISSING.match(why)
    cause = f"the shared library {lacking[1]} is missing" if lacking else why
    raise InputError(name, f"cannot be loaded: {cause}; scripts/setup.sh installs it")


@contextmanager
def read_by(
    reader: str, file: Path, made: str, seconds: float | None = None, request: str = ""
) -> Iterator[tuple[int, str, Path]]:
    """Run the script `reader FILE OUT`, since damaged files crash libraries: its exit status, what it said, and OUT.

    The `request` stands on its standard input.

    OUT is named `made`, in a folder that is gone afterwards.

    Raises:
        InputError: a library that cannot be loaded.
        TimeoutExpired: it took longer than `seconds`.
    """
    with tempfile.TemporaryDirectory(prefix="workbench-") as folder:
        out = Path(folder) / made
        child = subprocess.run(
            [sys.executable, "-P", reader, str(file.absolute()), str(out)],
            input=request.encode(),
            capture_output=True,
            check=False,
            cwd=folder,
            env=environment(),
            timeout=seconds,
        )
        said = child.stdout.decode(errors="replace")
        refuse_unloadable(child.returncode, said)
        yield child.returncode, said, out


def in_one_thread(function: Callable[..., T], *arguments: Any) -> T:
    """What a function of a module returns, from a process that keeps to one core: the same bytes every time.

    Open3D adds up in the order in which its threads come; how many there are, OpenMP's and TBB's, it asks once.

    Raises:
        InputError: the process ended early, with its last words.
    """
    call = pickle.dumps((function.__module__, function.__qualname__, arguments))
    done = subprocess.run(
        [sys.executable, "-P", "-m", "workbench.children"],
        input=call,
        capture_output=True,
        check=False,
        env=environment(OMP_NUM_THREADS="1"),
    )
    if done.returncode != 0:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        why = one_line(lines[-1]) if lines else f"its process ended with status {done.returncode}"
        raise InputError(function.__qualname__.strip("_"), f"cannot be worked out: {why}")
    made: T = pickle.loads(done.stdout)
    return made


def main() -> None:
    """The child: what libraries print goes to standard error, the result alone to standard output."""
    results = os.dup(1)
    os.dup2(2, 1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    module, name, arguments = pickle.load(sys.stdin.buffer)
    made = getattr(importlib.import_module(module), name)(*arguments)
    with open(results, "wb") as out:
        pickle.dump(made, out)


if __name__ == "__main__":
    main()
