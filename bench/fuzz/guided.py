"""`python -m bench.fuzz.guided`: the same readers, with mutations that lead to new lines of the package kept (atheris).

A reader of files of several kinds is fuzzed once for each. Troublesome files go to `--keep`. atheris stands in no lock
file: `pip install atheris`.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
OWN_SHARE = 0.5  # of the mutations, which know the format; the others are libFuzzer's
MOST_BYTES = 1 << 20


def compiled() -> list[str]:
    """Modules with functions that numba compiles: those cannot be instrumented."""
    files = (
        path for path in (ROOT / "workbench").rglob("*.py") if "kernels import" in path.read_text(encoding="utf-8")
    )
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files]


def child(name: str, suffix: str, seconds: int, seed: int, keep: Path) -> int:
    """One reader, one kind of file; prints what came of it."""
    import atheris

    with atheris.instrument_imports(include=["workbench"], exclude=compiled()):
        from bench.fuzz.run import Outcome, as_row, confine, judged
        from bench.fuzz.targets import TARGETS

        target = next(one for one in TARGETS if one.name == name)
        good = [path for path in target.files() if path.suffix == suffix and path.stat().st_size < MOST_BYTES]
        target.read(good[0])
    confine()
    outcome, begun, used = Outcome(f"{name}{suffix}"), time.monotonic(), sum(os.times()[:4])
    scratch = tempfile.mkdtemp()
    path = target.surroundings(Path(scratch)) / f"mutated{suffix}"
    corpus = Path(scratch) / "corpus"
    corpus.mkdir()
    for each in good:
        (corpus / each.name).write_bytes(each.read_bytes())
    warnings.simplefilter("ignore")

    def one(content: bytes) -> None:
        if begun + seconds < time.monotonic():  # libFuzzer ends the process without a word
            outcome.seconds = sum(os.times()[:4]) - used
            row = {**as_row(outcome), "kept": len(list(corpus.iterdir())) - len(good)}
            os.write(said, (json.dumps(row) + "\n").encode())
            os._exit(0)
        path.write_bytes(content)
        trouble = judged(target, path, outcome)
        if trouble and not outcome.failures[trouble]:
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{name}-{seed}-{len(outcome.failures)}{suffix}").write_bytes(content)
        outcome.failures.update([trouble] if trouble else [])

    def mutate(content: bytes, most: int, drawn: int) -> bytes:
        rng = random.Random(drawn)
        if rng.random() > OWN_SHARE and suffix != ".h5":
            return bytes(atheris.Mutate(content, most))
        try:
            return target.mutate(content, suffix, rng)[:most]
        except Exception:  # what was mutated before is no file of its kind any more
            return bytes(atheris.Mutate(content, most))

    said = os.dup(1)
    limits = [f"-seed={seed}", "-rss_limit_mb=0", "-timeout=0", f"-max_len={MOST_BYTES}", "-verbosity=0"]
    atheris.Setup([sys.argv[0], str(corpus), *limits], one, custom_mutator=mutate)
    atheris.Fuzz()
    return 0


def row(name: str, suffix: str, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """A child's; a child that died is a failure."""
    command = [sys.executable, "-m", "bench.fuzz.guided", "--child", name, suffix, "--keep", str(options.keep)]
    command += ["--seed", str(seed), "--seconds", str(options.seconds)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode == 0 and lines:
        return dict(json.loads(lines[-1]))
    died = f"the process ended with {done.returncode}: {done.stderr.strip()[-600:]}"
    return {
        "target": f"{name}{suffix}",
        "executions": 0,
        "accepted": 0,
        "seconds": 0.0,
        "kept": 0,
        "failures": {died: 1},
    }


def main() -> int:
    """Every reader and kind of file in a process of its own."""
    parser = argparse.ArgumentParser(prog="python -m bench.fuzz.guided", description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="for each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=1, help="how many, each in a process of its own")
    parser.add_argument("--only", nargs="*", help="readers")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=ROOT / "out" / "fuzz", help="folder for files that made trouble")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        return child(*options.child, options.seconds, options.seed, options.keep)
    from bench.fuzz.targets import TARGETS

    targets = [one for one in TARGETS if not options.only or one.name in options.only]
    kinds = [(one.name, suffix) for one in targets for suffix in sorted({path.suffix for path in one.files()})]
    work = [(*kind, options.seed + k) for kind in kinds for k in range(options.seeds)]
    with ThreadPoolExecutor(options.processes) as pool:
        rows = []
        for one in pool.map(lambda job: row(*job, options), work):
            rows.append(one)
            print(json.dumps(one), flush=True)
    total, hours = sum(one["executions"] for one in rows), sum(one["seconds"] for one in rows) / 3600
    failed = sum(sum(one["failures"].values()) for one in rows)
    print(f"{total:,} executions in {hours:.2f} processor hours, seed {options.seed}; failures: {failed}")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
