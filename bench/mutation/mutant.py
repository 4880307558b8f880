"""A copy of the project with one source changed, and the tests that are run on it.

What it compiles goes into a copy of the user's folder: kernels that the change does not reach are not made again, and
those of mutants are not kept.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.harness import ROOT
from workbench.user_folder import folder as users

COPIED = ("workbench", "bench", "tests", "pipelines", "data", "docs", "README.md", "pyproject.toml")
ENDLESS_S = 3600.0  # a mutant that runs longer is killed: the slowest set of tests takes a tenth of it
TEST_ENDLESS_S = 600  # a test that runs longer has failed; the kernels of a room compile in a minute or two
FAILED, INTERRUPTED = 1, 2  # status of pytest: tests failed; a module could not be imported


def fails(path: Path, source: str, tests: Sequence[str]) -> bool:
    """Whether the tests, in this order, fail or do not end, where the file `path` (relative) has another source."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        for item in COPIED:
            copy = shutil.copytree if (ROOT / item).is_dir() else shutil.copy
            copy(ROOT / item, Path(folder) / item)
        (Path(folder) / path).write_text(source, encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not metrology", *tests]
        command += ["-o", f"faulthandler_timeout={TEST_ENDLESS_S}", "-o", "faulthandler_exit_on_timeout=true"]
        environment = {**os.environ, "PYTHONPATH": folder, "NUMBA_CACHE_DIR": folder}
        if kept := users().path:
            shutil.copytree(kept, Path(folder) / f"workbench-{os.getuid()}")
        try:
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=ENDLESS_S
            )
        except subprocess.TimeoutExpired:
            return True
    if done.returncode not in (0, FAILED, INTERRUPTED):
        raise RuntimeError(f"pytest ended with {done.returncode}: {done.stdout[-500:]}{done.stderr[-500:]}")
    return done.returncode != 0
