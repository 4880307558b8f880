"""Compile the kernels that the shipped pipelines need, on all cores, so that the first run of a user does not wait.

Small parts run through planning, inspection and the simulator, each in a process of its own; what they compile is kept
in the user's folder (`workbench/user_folder.py`). Nothing else is written; a failure costs the first run its minute.
With `--into FOLDER` they are compiled for a family of processors and put there, for a wheel.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DATA, PIPELINES = ROOT / "data" / "synthetic", ROOT / "pipelines"
TASKS = {  # the longest first
    "planning": ("run", PIPELINES / "plan_bevel.json", "--input", f"recording={DATA / 'raw_edge.h5'}"),
    "inspection": ("run", PIPELINES / "inspect_bevel.json", "--input", f"recording={DATA / 'milled_edge.h5'}"),
    "simulation": ("run", PIPELINES / "closed_loop.json", "--no-report"),
}


def compile_for(name: str, folder: Path, environment: dict[str, str]) -> str:
    """Run one task; what to say of it."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "workbench", *map(str, TASKS[name]), "--out", str(folder / name)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, env=environment)
    if done.returncode > 1:
        return f"{name} did not run: {(done.stderr.strip() or '?').splitlines()[-1]}"
    return f"{name}, {time.perf_counter() - start:.0f} s"


def compile_all(environment: dict[str, str]) -> None:
    """Run all tasks, telling of each."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(max(1, os.cpu_count() or 1)) as pool:
        for number, said in enumerate(pool.map(lambda name: compile_for(name, Path(folder), environment), TASKS), 1):
            print(f"setup: compiled {number}/{len(TASKS)}: {said}", flush=True)


def compile_into(made: Path) -> None:
    """Kernels for a family of processors, in a folder that holds nothing else."""
    from workbench.kernels import BASELINE

    shutil.rmtree(made, ignore_errors=True)
    made.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as kept:
        chosen = {"NUMBA_CACHE_DIR": kept, "NUMBA_CPU_NAME": BASELINE[0], "NUMBA_CPU_FEATURES": BASELINE[1]}
        compile_all({**os.environ, **chosen})
        for path in Path(kept).rglob("*.kernel"):
            shutil.copy(path, made)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--into", type=Path, metavar="FOLDER", help="compile for a wheel")
    into = parser.parse_args().into
    print(f"setup: compiling kernels for {into or 'this machine'}: once, about a minute", flush=True)
    if into:
        compile_into(into)
    else:
        compile_all(dict(os.environ))
    return 0


if __name__ == "__main__":
    sys.exit(main())
