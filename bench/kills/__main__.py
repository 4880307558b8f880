"""`python -m bench.kills`: SIGKILL at random moments of plan, inspect and batch; the table in docs/reliability.md."""

from __future__ import annotations

import argparse
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from bench.kills.sets import leftovers, whole_sets
from bench.tables import markdown, put_into

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "reliability.md"
DATA = ROOT / "data" / "synthetic"
PARTS = ("milled_edge.h5", "milled_arc.h5")
COMMANDS = {
    "inspect": ["run", str(ROOT / "pipelines/inspect_bevel.json")],
    "plan": ["run", str(ROOT / "pipelines/plan_bevel.json")],
    "batch": ["batch", str(ROOT / "pipelines/inspect_bevel.json"), *(str(DATA / name) for name in PARTS)],
}
LEFT = NONE, OLD, NEW = "none", "the old results whole", "the new results whole"
WORKS = "works"
LATE_SHARE = 0.5  # of the kills fall into the last tenth, where files are written


def main() -> int:
    """Kill, look, run again, look again."""
    parser = argparse.ArgumentParser(prog="python -m bench.kills", description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--docs", action="store_true", help="write the paragraph into docs/reliability.md")
    options = parser.parse_args()
    rng = random.Random(options.seed)
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as scratch:
        usual = {name: _whole_run(name, Path(scratch) / "usual" / name) for name in COMMANDS}
        for k in range(options.runs):
            name = list(COMMANDS)[k % len(COMMANDS)]
            out = Path(scratch) / name
            state = _killed(name, out, usual[name] * _moment(rng), usual[name], rng)
            found[f"{name}: {state}"] += 1
            print(f"{k + 1}/{options.runs} {name}: {state}", flush=True)
            if k % (5 * len(COMMANDS)) >= 4 * len(COMMANDS):  # let one run end, and now and then begin afresh
                found[f"{name}, the next run: {_next_run(name, out)}"] += 1
    for what, count in sorted(found.items()):
        print(f"{count:5} x {what}")
    if options.docs:
        _write(found, options.runs, options.seed)
    return int(any("BROKEN" in what for what in found))


def _moment(rng: random.Random) -> float:
    """When to kill, as a share of what a run takes."""
    return rng.uniform(0.9, 1.02) if rng.random() < LATE_SHARE else rng.uniform(0.0, 0.9)


def _command(name: str, out: Path) -> list[str]:
    return [sys.executable, "-m", "workbench", *COMMANDS[name], "--out", str(out)]


def _whole_run(name: str, out: Path) -> float:
    """Median time of three whole runs, s."""
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        subprocess.run(_command(name, out), capture_output=True, check=True)
        seconds.append(time.perf_counter() - start)
        if name == "batch":
            for path in out.rglob("run.json"):
                path.unlink()  # else the next one skips its parts
    return statistics.median(seconds)


def _killed(name: str, out: Path, after_s: float, usual_s: float, rng: random.Random) -> str:
    """What a killed run left: old, new, none or BROKEN."""
    before = whole_sets(out)
    process = subprocess.Popen(
        _command(name, out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        process.wait(timeout=after_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    after = whole_sets(out)
    if after is None:
        return "BROKEN"
    if after == before:
        return OLD if before else NONE
    return NEW if after else NONE


def _next_run(name: str, out: Path) -> str:
    """Whether the next run works and tidies up."""
    done = subprocess.run(_command(name, out), capture_output=True, check=False)
    if done.returncode != 0 or not whole_sets(out):
        return f"BROKEN ({done.returncode})"
    return WORKS if not leftovers(out) else f"BROKEN (left {leftovers(out)[0].name})"


def _write(found: Counter[str], runs: int, seed: int) -> None:
    rows = []
    for name in COMMANDS:
        broken = sum(count for what, count in found.items() if what.startswith(name) and "BROKEN" in what)
        counts = [*(found[f"{name}: {state}"] for state in LEFT), found[f"{name}, the next run: {WORKS}"], broken]
        rows.append([name, *map(str, counts)])
    table = markdown(["command", *LEFT, "next runs that work", "broken"], rows)
    put_into(PAGE, "\n".join([*table, "", f"{runs} kills, seed {seed}."]), "kills")


if __name__ == "__main__":
    sys.exit(main())
