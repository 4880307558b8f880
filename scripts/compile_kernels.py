"""Compile the kernels that the shipped pipelines need, on all cores, so that the first run of a user does not wait.

Small parts run through planning, inspection and the simulator, each in a process of its own; what they compile is kept
in the user's folder (`workbench/user_folder.py`). Nothing else is written; a failure costs the first run its minute.
"""

import os
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


def compile_for(name: str, folder: Path) -> str:
    """Run one task; what to say of it."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "workbench", *map(str, TASKS[name]), "--out", str(folder / name)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    if done.returncode > 1:
        return f"{name} did not run: {(done.stderr.strip() or '?').splitlines()[-1]}"
    return f"{name}, {time.perf_counter() - start:.0f} s"


def main() -> int:
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(max(1, os.cpu_count() or 1)) as pool:
        print("setup: compiling kernels for this machine: once, about a minute", flush=True)
        for number, said in enumerate(pool.map(lambda name: compile_for(name, Path(folder)), TASKS), 1):
            print(f"setup: compiled {number}/{len(TASKS)}: {said}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
