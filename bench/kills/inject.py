"""`python -m bench.kills.inject`: a fault drawn by seed in the file operations of each command that writes; the table.

What is computed is computed once. A forked child then writes it and meets one fault at its n-th open, write, read of a
file, close, rename, unlink, mkdir, rmdir, chmod or fsync: it is killed, the disk is full from then on, the device
fails once or from then on, or a write takes only half. Half of the time a second child meets another fault; a last one
meets none. What stands in between and in the end must be whole: the old results, the new ones, or none; a fault that
does not kill ends in one of the project's own errors, or does no harm. HDF5 writes in C: its files meet faults before
each data set and before they are closed, and in the file under them. `--only NAME --seed N --cases 1` replays a case.
"""

from __future__ import annotations

import argparse
import builtins
import contextlib
import errno
import io
import json
import os
import random
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NoReturn

from bench.kills.sets import digest_of, leftovers, whole_sets

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "bench" / "fuzz" / "corpus"
CALLS = ("rename", "replace", "unlink", "remove", "mkdir", "rmdir", "chmod", "fsync", "truncate", "posix_fallocate")
WRITTEN = ("r", "rb", "rt")  # modes that write nothing


ALIVE = 2  # exit status of a child that told an error
Kind = Literal["none", "killed", "full disk", "device error", "device lost", "short write"]
KINDS: tuple[Kind, ...] = ("killed", "full disk", "device error", "device lost", "short write")
GROWS = ("open", "write", "mkdir", "posix_fallocate", "dataset")  # what needs room


class Fault:
    """Counts operations on files; what it is happens at the n-th."""

    def __init__(self, kind: Kind, at: int) -> None:
        self.kind, self.at, self.done = kind, at, 0

    def step(self, operation: str) -> None:
        """One more operation."""
        self.done += 1
        if self.kind == "killed" and self.done == self.at:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.kind == "full disk" and self.done >= self.at and operation in GROWS:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        once = self.kind == "device error" and self.done == self.at
        if once or (self.kind == "device lost" and self.done >= self.at):
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    def install(self) -> None:
        """For the rest of this process."""
        import h5py

        for name in CALLS:
            setattr(os, name, self._counted(name, getattr(os, name)))
        plain = io.open

        def opened(file: Any, mode: str = "r", *rest: Any, **more: Any) -> Any:
            reads = mode in WRITTEN
            self.step("read" if reads else "open")
            return plain(file, mode, *rest, **more) if reads else Torn(plain(file, mode, *rest, **more), self)

        io.open = builtins.open = opened  # type: ignore[assignment]
        for owner, name in ((h5py.Group, "create_dataset"), (h5py.Dataset, "__setitem__")):
            setattr(owner, name, self._counted("dataset", getattr(owner, name)))

    def _counted(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **more: Any) -> Any:
            self.step(name)
            return call(*arguments, **more)

        return counted


class Torn:
    """A file whose writes come in two halves, with a moment for a fault before, between and after."""

    def __init__(self, file: Any, fault: Fault) -> None:
        self._file, self._fault = file, fault

    def write(self, content: Any) -> int:
        """Both halves; the first alone where the file has no buffer, which would ask again, and writes are short."""
        half = len(content) // 2
        self._fault.step("write")
        if self._fault.kind == "short write" and isinstance(self._file, io.RawIOBase) and half:
            return int(self._file.write(content[:half]))
        self._file.write(content[:half])
        self._file.flush()
        self._fault.step("write")
        self._file.write(content[half:])
        self._file.flush()
        return len(content)

    def close(self) -> None:
        """A moment before it."""
        try:
            if not self._file.closed:
                self._fault.step("close")
        finally:
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
    suffix: str = ""


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
    from workbench.errors import OutputError

    recording, pipeline = CORPUS / "inspecting" / "small.h5", ROOT / "pipelines" / "inspect_bevel.json"

    def write(out: Path) -> None:
        done = run_batch(pipeline, [str(recording)], str(out), workers=0, report=False)
        if done.exit_status == 2:
            raise OutputError(str(out), "told as failed")

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
    return Command("import", lambda out: import_files(sources, out), recording_state, recording_left, suffix=".h5")


def simulating(scratch: Path) -> Command:
    """`workbench simulate` of a short edge."""
    from workbench.synthetic.simulate import simulate_file

    recipe = json.loads((ROOT / "data/synthetic/milled_edge.json").read_text())
    recipe["part"]["length_mm"] = 12
    recipe["scanner"].update(columns=60, pitch_mm=0.4)
    recipe["passes"][0].update(from_mm=3, to_mm=9)
    place = scratch / "short.json"
    place.write_text(json.dumps(recipe))
    return Command("simulate", lambda out: simulate_file(place, out), recording_state, recording_left, suffix=".h5")


def in_child(command: Command, out: Path, fault: Fault, old: bool = False) -> str:
    """How a child ended that writes with a fault: "written", "killed", "told", or what it did wrong."""
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if not child:
            _write_and_exit(
                command.write_old if old and command.write_old else command.write, out, fault, said.fileno()
            )
        _, ended = os.waitpid(child, 0)
        said.seek(0)
        text = said.read().decode(errors="replace").strip()
    if os.WIFSIGNALED(ended):
        return "killed" if fault.kind == "killed" else f"WRONG: signal {os.WTERMSIG(ended)}"
    status = os.WEXITSTATUS(ended)
    return {0: "written", ALIVE: "told"}.get(status, f"WRONG: {text[-400:]}")


def _write_and_exit(write: Callable[[Path], object], out: Path, fault: Fault, said: int) -> NoReturn:
    from workbench.errors import WorkbenchError

    status = 3
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(said, 2)
        fault.install()
        write(out)
        status = 0
    except WorkbenchError:
        status = ALIVE
    except BaseException:
        os.write(2, traceback.format_exc().encode())
    finally:
        os._exit(status)


def operations(command: Command, place: Path, old: bool) -> int:
    """How many operations on files the command makes without a fault."""
    reader, writer = os.pipe()

    def counted(out: Path) -> None:
        command.write(out)
        os.write(writer, str(fault.done).encode())

    fault = Fault("none", 0)
    if old:
        in_child(command, place, Fault("none", 0), old=True)
    in_child(replace(command, write=counted), place, fault)
    os.close(writer)
    with os.fdopen(reader) as said:
        return int(said.read())


def case(command: Command, scratch: Path, new: object, counts: tuple[int, int], rng: random.Random) -> Counter[str]:
    """One drawn fault, half of the time over an older set; half of the time another after it; then none."""
    found: Counter[str] = Counter()
    old = rng.random() < 0.5
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        place = Path(folder) / f"out{command.suffix}"
        if old:
            in_child(command, place, Fault("none", 0), old=True)
        for _ in range(rng.randint(1, 2)):
            before, left = command.state(place), command.left(place)
            fault = Fault(rng.choice(KINDS), rng.randint(1, counts[old]))
            ended = in_child(command, place, fault)
            found[fault.kind] += 1
            found[_judged(command, place, before, new, ended, fault)] += 1
            more = [path for path in command.left(place) if path not in left]
            if ended == "told" and fault.kind == "full disk" and more:
                found[f"BROKEN: {fault.kind} at {fault.at}: left {more}"] += 1
        ended = in_child(command, place, Fault("none", 0))
        whole = ended == "written" and command.state(place) == new and not command.left(place)
        found["the next run works" if whole else f"BROKEN: the next run, {ended}, {command.left(place)}"] += 1
    return found


def _judged(command: Command, place: Path, before: object, new: object, ended: str, fault: Fault) -> str:
    after = command.state(place)
    if ended.startswith("WRONG"):
        return f"BROKEN: {fault.kind} at {fault.at}: {ended}"
    if ended == "written" and after != new:
        return f"BROKEN: {fault.kind} at {fault.at}: told as written and is not"
    if after is None and _changing(place):
        return "changing"
    if after == before and after is not None:
        return "the old results whole" if before else "none"
    if after == new:
        return "the new results whole"
    if after in ("", {}):
        return "none"
    there = sorted(str(path.relative_to(place.parent)) for path in place.parent.rglob("*"))
    return f"BROKEN: {fault.kind} at {fault.at}: {'a mixture' if after else 'not whole'}: {there}"


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


def commands(scratch: Path) -> dict[str, Callable[[], Command]]:
    """Each command that writes, made when it is asked for."""
    small = {"recording": str(CORPUS / "inspecting/small.h5")}
    return {
        "run": lambda: publishing("run", "inspect_bevel.json", small),
        "calibrate": lambda: publishing("calibrate", "calibrate_handeye.json", {}),
        "posture": lambda: publishing("posture", "optimise_posture.json", {}),
        "batch": batch,
        "import": lambda: importing(scratch),
        "simulate": lambda: simulating(scratch),
    }


def main() -> int:
    """Every command; the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.kills.inject", description=__doc__)
    parser.add_argument("--cases", type=int, default=1_500, help="of each command")
    parser.add_argument("--only", nargs="*", help="commands")
    parser.add_argument("--seed", type=int, default=1, help="of the first case; the next has the next")
    options = parser.parse_args()
    rows, bad = [], 0
    with tempfile.TemporaryDirectory() as folder:
        made = commands(Path(folder))
        for name in options.only or made:
            found = _all_cases(name, made[name](), Path(folder), range(options.seed, options.seed + options.cases))
            broken = sum(count for what, count in found.items() if what.startswith("BROKEN"))
            bad += broken
            kinds = (*KINDS, "none", "the old results whole", "the new results whole", "changing", "the next run works")
            rows.append([name, *(f"{found[kind]:,}" for kind in kinds), str(broken)])
            print(rows[-1], flush=True)
    heads = ("command", *KINDS, "none", "old", "new", "under way", "next run works", "broken")
    print("\n".join(f"| {' | '.join(row)} |" for row in [heads, ["---"] * len(heads), *rows]))
    return int(bad > 0)


def _all_cases(name: str, command: Command, scratch: Path, seeds: range) -> Counter[str]:
    usual = Path(tempfile.mkdtemp(dir=scratch)) / f"out{command.suffix}"
    counts = operations(command, usual, old=False), operations(command, usual.with_name(f"old{command.suffix}"), True)
    new = command.state(usual)
    found: Counter[str] = Counter()
    for seed in seeds:
        one = case(command, scratch, new, counts, random.Random(f"{name} {seed}"))
        found += one
        for what in one:
            if what.startswith("BROKEN"):
                print(f"{name}, seed {seed}: {what}", flush=True)
    return found


if __name__ == "__main__":
    sys.exit(main())
