"""`python -m bench.kills.inject`: SIGKILL before every operation on files, of each command that writes; the table.

What is computed is computed once. A forked child then writes it, and is killed before its n-th open, write, close,
rename, unlink, mkdir, rmdir, chmod or fsync, or in the middle of a write, for every n. Another child does it again, and
half of the time is killed itself at a drawn place; a last one is not. What stands in between and in the end must be
whole: the old results, the new ones, or none. HDF5 writes in C: its files are killed before each data set and before
they are closed.
"""

from __future__ import annotations

import argparse
import builtins
import contextlib
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.kills.sets import digest_of, leftovers, whole_sets

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "bench" / "fuzz" / "corpus"
CALLS = ("rename", "replace", "unlink", "remove", "mkdir", "rmdir", "chmod", "fsync", "utime", "link", "truncate")
WRITTEN = ("r", "rb", "rt")  # modes that write nothing


class Killer:
    """Counts operations on files; ends the process before the n-th, as SIGKILL does. 0: never."""

    def __init__(self, at: int) -> None:
        self.at, self.done = at, 0

    def step(self) -> None:
        """One more operation."""
        self.done += 1
        if self.done == self.at:
            os.kill(os.getpid(), signal.SIGKILL)

    def install(self) -> None:
        """For the rest of this process."""
        import h5py

        for name in CALLS:
            setattr(os, name, self._counted(getattr(os, name)))
        plain = io.open

        def opened(file: Any, mode: str = "r", *rest: Any, **more: Any) -> Any:
            if mode in WRITTEN:
                return plain(file, mode, *rest, **more)
            self.step()
            return Torn(plain(file, mode, *rest, **more), self)

        io.open = builtins.open = opened  # type: ignore[assignment]
        for owner, name in ((h5py.Group, "create_dataset"), (h5py.File, "close"), (h5py.Dataset, "__setitem__")):
            setattr(owner, name, self._counted(getattr(owner, name)))

    def _counted(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **more: Any) -> Any:
            self.step()
            return call(*arguments, **more)

        return counted


class Torn:
    """A file whose writes come in two halves, with a moment to be killed before, between and after."""

    def __init__(self, file: Any, killer: Killer) -> None:
        self._file, self._killer = file, killer

    def write(self, content: Any) -> int:
        """Both halves."""
        for half in (content[: len(content) // 2], content[len(content) // 2 :]):
            self._killer.step()
            self._file.write(half)
            self._file.flush()
        return len(content)

    def close(self) -> None:
        """A moment before it."""
        if not self._file.closed:
            self._killer.step()
        self._file.close()

    def __enter__(self) -> Torn:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._file)


@dataclass(frozen=True)
class Command:
    """One that writes: what it does with a place, and what stands there, None where that is not whole."""

    name: str
    write: Callable[[Path], object]
    state: Callable[[Path], object]
    left: Callable[[Path], list[Path]]
    write_old: Callable[[Path], object] | None = None  # of other bytes than `write`, so that a mixture would show


def publishing(name: str, pipeline: str, inputs: dict[str, Any]) -> Command:
    """`workbench run`, its results computed once."""
    from workbench.pipeline import Pipeline
    from workbench.pipeline.output import OutputDirectory
    from workbench.pipeline.run import run_files, run_plan
    from workbench.pipeline.terminal import Reporter

    checked = Pipeline.load(ROOT / "pipelines" / pipeline).plan(inputs)
    files = run_files(checked, run_plan(checked, Reporter()))

    def write(out: Path, made: dict[str, bytes] = files) -> None:
        target = OutputDirectory(out)
        with target.reserved():
            target.publish(made)

    older = {name: content + b"\n" for name, content in files.items()}
    return Command(name, write, whole_sets, leftovers, lambda out: write(out, older))


def once(make: Callable[..., Any]) -> Callable[..., Any]:
    """`make`, which is called the first time only."""
    made: list[Any] = []

    def kept(*arguments: Any) -> Any:
        if not made:
            made.append(make(*arguments))
        return made[0]

    return kept


def batch() -> Command:
    """`workbench batch` of one part in this process, measured and drawn once."""
    from workbench.batch import fleet, part, run_batch

    recording, pipeline = CORPUS / "inspecting" / "small.h5", ROOT / "pipelines" / "inspect_bevel.json"

    def write(out: Path) -> None:
        run_batch(pipeline, [str(recording)], str(out), workers=0, report=False)

    part.run_plan, fleet.fleet_files = once(part.run_plan), once(fleet.fleet_files)
    with tempfile.TemporaryDirectory() as scratch:
        write(Path(scratch) / "first")
    return Command("batch", write, whole_sets, leftovers)


def recording_state(path: Path) -> object:
    """Digest of a recording; '' without one, None where it cannot be read."""
    from workbench.errors import WorkbenchError
    from workbench.scan import read

    if not path.exists():
        return ""
    with contextlib.suppress(WorkbenchError):
        return hash(read(recording=path).z_mm.tobytes())
    return None


def recording_left(path: Path) -> list[Path]:
    """Half-written ones."""
    return [*path.parent.glob(f".{path.name}.*"), *path.parent.glob(f".{path.stem}.*partial*")]


def importing(scratch: Path) -> Command:
    """`workbench import` of a small recording's profiles and poses as tables."""
    import numpy as np

    from workbench.importing.command import import_files
    from workbench.scan import read

    one = read(recording=str(CORPUS / "inspecting" / "small.h5"))
    frames, columns = one.x_mm.shape
    number = np.repeat(np.arange(frames), columns)
    points = np.column_stack([number, one.time_s[number], one.x_mm.ravel(), one.z_mm.ravel()])
    poses = np.column_stack([one.robot_time_s, one.robot_position_mm, one.robot_quaternion_wxyz])
    sources = [scratch / "profiles.csv", scratch / "poses.csv"]
    heads = ("frame,time_s,x_mm,z_mm", "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz")
    for place, head, rows in zip(sources, heads, (points, poses), strict=True):
        np.savetxt(place, rows, "%.8f", ",", header=head, comments="")
    return Command("import", lambda out: import_files(sources, out), recording_state, recording_left)


def simulating(scratch: Path) -> Command:
    """`workbench simulate` of a short edge."""
    from workbench.synthetic.simulate import simulate_file

    recipe = json.loads((ROOT / "data/synthetic/milled_edge.json").read_text())
    recipe["part"]["length_mm"] = 12
    recipe["scanner"].update(columns=60, pitch_mm=0.4)
    recipe["passes"][0].update(from_mm=3, to_mm=9)
    place = scratch / "short.json"
    place.write_text(json.dumps(recipe))
    return Command("simulate", lambda out: simulate_file(place, out), recording_state, recording_left)


def in_child(command: Command, out: Path, at: int, old: bool = False) -> bool:
    """Whether a child that is killed before operation `at` ended by itself."""
    child = os.fork()
    if not child:
        status = 3
        try:
            devnull = os.open(os.devnull, os.O_WRONLY)
            os.dup2(devnull, 1)
            os.dup2(devnull, 2)
            killer = Killer(at)
            killer.install()
            (command.write_old if old and command.write_old else command.write)(out)
            status = 0
        finally:
            os._exit(status)
    done = os.waitpid(child, 0)[1]
    if os.WIFEXITED(done) and os.WEXITSTATUS(done):
        raise RuntimeError(f"{command.name}: the child failed by itself")
    return os.WIFEXITED(done)


def cases(command: Command, scratch: Path, kills: int, rng: random.Random) -> Counter[str]:
    """Kill at every operation, with nothing there before and over an older set, until there were so many kills."""
    found: Counter[str] = Counter()
    suffix = ".h5" if command.state is recording_state else ""
    usual = Path(tempfile.mkdtemp(dir=scratch)) / f"out{suffix}"
    in_child(command, usual, 0)
    new = command.state(usual)
    count = 0
    while count < kills:
        for old in (False, True):
            at = 0
            ended = False
            while not ended and count < kills:
                at += 1
                place = Path(tempfile.mkdtemp(dir=scratch)) / f"out{suffix}"
                if old:
                    in_child(command, place, 0, old=True)
                before = command.state(place)
                ended = in_child(command, place, at)
                if ended:
                    shutil.rmtree(place.parent)
                    break
                count += 1
                found[_judged(command, place, before, new)] += 1
                if rng.random() < 0.5:
                    between = command.state(place)
                    again = in_child(command, place, rng.randint(1, max(2 * at, 20)))
                    if not again:
                        count += 1
                        found[_judged(command, place, between, new)] += 1
                in_child(command, place, 0)
                whole = command.state(place)
                works = whole == new and not command.left(place)
                found["the next run works" if works else "BROKEN: the next run"] += 1
                if not works:
                    print(f"{command.name} {'over old' if old else 'fresh'}, operation {at}: {command.left(place)}")
                shutil.rmtree(place.parent)
    found["kills"] = count
    return found


def _judged(command: Command, place: Path, before: object, new: object) -> str:
    after = command.state(place)
    if after is None and _changing(place):
        return "changing"
    if after == before and after is not None:
        return "the old results whole" if before else "none"
    if after == new:
        return "the new results whole"
    if after in ("", {}):
        return "none"
    there = sorted(str(path.relative_to(place.parent)) for path in place.parent.rglob("*"))
    print(f"{command.name}: BROKEN: {'a mixture' if after else 'not whole'}: {there}", flush=True)
    return "BROKEN"


def _changing(place: Path) -> bool:
    """Whether the set of results lacks its run.json, as it does while files change places, and all there are whole."""
    from workbench.pipeline.output import MOVING

    folders = [place, *(path for path in place.iterdir() if path.is_dir() and not path.name.startswith("."))]
    unmarked = [one for one in folders if digest_of(one) is None]
    for folder in unmarked:
        if (folder / "run.json").exists() or not [*folder.glob(f".*/{MOVING}")]:
            return False
        for path in folder.glob("*.json"):
            json.loads(path.read_bytes())
    return True


def main() -> int:
    """Every command; the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.kills.inject", description=__doc__)
    parser.add_argument("--kills", type=int, default=10_000, help="in all")
    parser.add_argument("--only", nargs="*", help="commands")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows, begun = [], time.process_time()
    with tempfile.TemporaryDirectory() as scratch:
        made: dict[str, Callable[[], Command]] = {
            "run": lambda: publishing("run", "inspect_bevel.json", {"recording": str(CORPUS / "inspecting/small.h5")}),
            "calibrate": lambda: publishing("calibrate", "calibrate_handeye.json", {}),
            "posture": lambda: publishing("posture", "optimise_posture.json", {}),
            "batch": batch,
            "import": lambda: importing(Path(scratch)),
            "simulate": lambda: simulating(Path(scratch)),
        }
        chosen = options.only or list(made)
        for name in chosen:
            rng = random.Random(f"{name} {options.seed}")
            found = cases(made[name](), Path(scratch), options.kills // len(chosen), rng)
            rows.append(_row(name, found))
            print(rows[-1], flush=True)
    heads = (
        "command",
        "kills",
        "none there",
        "the old whole",
        "the new whole",
        "changing places",
        "next runs that work",
        "broken",
    )
    table = "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *rows])
    print(f"{time.process_time() - begun:.0f} s of processor time, children excepted")
    print(table)
    return int(any(not row.endswith("| 0 |") for row in rows))


def _row(name: str, found: Counter[str]) -> str:
    kinds = ("none", "the old results whole", "the new results whole", "changing", "the next run works")
    broken = sum(count for what, count in found.items() if what.startswith("BROKEN"))
    return f"| {name} | {found['kills']:,} | " + " | ".join(f"{found[kind]:,}" for kind in kinds) + f" | {broken} |"


if __name__ == "__main__":
    sys.exit(main())
