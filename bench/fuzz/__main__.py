"""`make fuzz`: mutated files for every reader; the table in docs/reliability.md."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from bench.fuzz.run import as_row, confine, fuzz
from bench.fuzz.targets import TARGETS
from bench.harness import ROOT, made_by
from bench.tables import put_into, written

PAGE = ROOT / "docs" / "reliability.md"


def main() -> int:
    """Every target in a process of its own: one that crashes is told, and ends no other."""
    parser = argparse.ArgumentParser(prog="python -m bench.fuzz", description=__doc__)
    parser.add_argument("--executions", type=int, default=100_000, help="of each target, times its share")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=[target.name for target in TARGETS], nargs="*")
    parser.add_argument("--keep", type=Path, default=ROOT / "out" / "fuzz", help="folder for files that made trouble")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/reliability.md")
    parser.add_argument("--child", choices=[target.name for target in TARGETS], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        return _child(options)
    rows = []
    for target in TARGETS:
        if not options.only or target.name in options.only:
            rows.append(_row(target.name, max(1, round(options.executions * target.share)), options))
            print(
                _line(rows[-1]), *(f"  {n} x {what}" for what, n in rows[-1]["failures"].items()), sep="\n", flush=True
            )
    if options.docs:
        _write(rows, options.seed)
    return int(any(row["failures"] for row in rows))


def _child(options: argparse.Namespace) -> int:
    target = next(target for target in TARGETS if target.name == options.child)
    target.read(target.files()[0])  # imports and compiles
    confine()
    print(json.dumps(as_row(fuzz(target, options.executions, options.seed, options.keep))))
    return 0


def _row(name: str, executions: int, options: argparse.Namespace) -> dict[str, Any]:
    command = [sys.executable, "-m", "bench.fuzz", "--child", name, "--executions", str(executions)]
    command += ["--seed", str(options.seed), "--keep", str(options.keep)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    if done.returncode == 0:
        row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return row
    died = f"the process ended with {done.returncode}: {done.stderr.strip()[-200:]}"
    nothing = {"executions": 0, "accepted": 0, "refused": 0, "seconds": 0.0, "slowest_s": 0.0}
    return {"target": name, **nothing, "failures": {died: 1}}


def _line(row: dict[str, Any]) -> str:
    judged = f"{row['accepted']:8,} accepted, {row['refused']:9,} refused"
    done = f"{row['target']:12} {row['executions']:9,} executions, {judged}, slowest {row['slowest_s']:.2f} s"
    return f"{done}, {sum(row['failures'].values())} failures, {row['seconds']:.0f} s"


def _write(rows: list[dict[str, Any]], seed: int) -> None:
    head = ["reader", "executions", "accepted, the rest refused with one line", "slowest, s"]
    cells = [[r["target"], f"{r['executions']:,}", f"{r['accepted']:,}", f"{r['slowest_s']:.2f}"] for r in rows]
    failed = sum(sum(r["failures"].values()) for r in rows)
    place = written(PAGE, "fuzz", head, cells)
    slowest = max(r["slowest_s"] for r in rows)
    total = f"`python -m bench.fuzz`{made_by()}: {sum(r['executions'] for r in rows):,} executions, seed {seed}; "
    total += f"slowest {slowest:.2f} s"
    put_into(PAGE, f"{total}. Failures: {failed}. [Every reader]({place}).", "fuzz")


if __name__ == "__main__":
    sys.exit(main())
