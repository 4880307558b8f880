"""A copy of the project with one source changed, and the tests that are run on it.

What it compiles goes into a copy of the user's folder: kernels that the change does not reach are not made again, and
those of mutants are not kept.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from workbench.user_folder import folder as users

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("workbench", "bench", "tests", "pipelines", "data", "docs", "README.md", "pyproject.toml")
ENDLESS_S = 1200.0  # a mutant that runs longer is killed: the slowest set of tests takes a quarter of it
FAILED, INTERRUPTED = 1, 2  # status of pytest: tests failed; a module could not be imported


def fails(path: Path, source: str, tests: Sequence[str], only: dict[str, Any] | None = None) -> bool:
    """Whether the tests fail, or do not end, where the file `path` (relative) has another source.

    `only`, of `bench.mutation.reach`, says which of them are run, in which order.
    """
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        for item in COPIED:
            copy = shutil.copytree if (ROOT / item).is_dir() else shutil.copy
            copy(ROOT / item, Path(folder) / item)
        (Path(folder) / path).write_text(source, encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "not metrology", *tests]
        environment = {**os.environ, "PYTHONPATH": folder, "NUMBA_CACHE_DIR": folder}
        if kept := users().path:
            shutil.copytree(kept, Path(folder) / f"workbench-{os.getuid()}")
        if only is not None:
            environment["REACH_RUN"] = f"{folder}/only.json"
            Path(environment["REACH_RUN"]).write_text(json.dumps(only), encoding="utf-8")
            command += ["-p", "bench.mutation.reach"]
        try:
            done = subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=ENDLESS_S
            )
        except subprocess.TimeoutExpired:
            return True
    if done.returncode not in (0, FAILED, INTERRUPTED):
        raise RuntimeError(f"pytest ended with {done.returncode}: {done.stdout[-500:]}{done.stderr[-500:]}")
    return done.returncode != 0
