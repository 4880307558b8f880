"""`python -m bench.kills`: a fault drawn by seed in the file operations of each command that writes; the table.

What is computed is computed once. A forked child then writes it and meets one fault at its n-th operation on files, in
libc (`faults.c`, so under HDF5 and SQLite too): it is killed, the disk is full from then on, the device fails once or
from then on, writes or reads take half. Half of the time a second child meets another fault; a last one meets none.
What stands in between and in the end must be whole: the old results, the new ones, or none, and of the page's store all
that was acknowledged; a fault that does not kill ends in one of the project's own errors, or does no harm.
`--only NAME --seed N --cases 1` replays a case.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import random
import subprocess
import sys
import tempfile
import time
import traceback
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

from bench.harness import ROOT, Option, Study, forked
from bench.kills.sets import digest_of, leftovers, whole_sets
from bench.recordings import write_tables
from bench.tables import markdown

CORPUS = ROOT / "bench" / "fuzz" / "corpus"
SCRATCH = Path("/dev/shm")  # the faults are drawn: a real disk would only add its own waits
READ: dict[bytes, object] = {}  # the state of a recording by its content
PAGE_RUNS = 4  # in the page's store
QUEUE_EVERY = 20  # seeds: its runs are processes
LASTING, STANDS_STILL = ("full disk", "device lost"), "the queue stands still"
WAIT_S = 120.0  # for what the page's queue does, on a loaded machine too

ALIVE = 2  # exit status of a child that told an error
KINDS = ("killed", "full disk", "device error", "device lost", "short write", "short read")  # as in faults.c
STATES = NONE, OLD, NEW, CHANGING = "none", "the old results whole", "the new results whole", "changing"


@dataclass(frozen=True)
class Fault:
    """What happens at the n-th operation on a file below a place."""

    kind: str = "none"
    at: int = 0

    def arm(self, place: Path) -> None:
        """For the rest of this process."""
        number = KINDS.index(self.kind) + 1 if self.kind in KINDS else 0
        ctypes.CDLL(None).arm_faults(number, self.at, os.fsencode(place))


@dataclass(frozen=True)
class Command:
    """One that writes: what it does with a place, and what stands there, None where that is not whole."""

    name: str
    write: Callable[[Path], object]
    state: Callable[[Path], object]
    left: Callable[[Path], list[Path]]
    write_old: Callable[[Path], object] | None = None  # of other bytes than `write`, so that a mixture would show
    suffix: str = ""
    between: Callable[[object], bool] = lambda state: False  # whether a state that is neither old nor new is lawful
    new: object = None  # what stands there once it was written
    counts: tuple[int, int] = (0, 0)  # of operations on files without a fault, on none and on old results


def publishing(name: str, pipeline: str, inputs: dict[str, Any]) -> Command:
    """`workbench run`, its results computed once."""
    from workbench.pipeline import Pipeline
    from workbench.pipeline.output import OutputDirectory
    from workbench.pipeline.run import run_files, run_plan
    from workbench.pipeline.terminal import Reporter

    checked = Pipeline.load(ROOT / "pipelines" / pipeline).plan(inputs)
    files = forked(lambda: run_files(checked, run_plan(checked, Reporter())))

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
    """Digest of a recording; '' without one, None where it cannot be read. The same bytes are read once."""
    from workbench.errors import WorkbenchError
    from workbench.scan import read

    if not path.exists():
        return ""
    content = path.read_bytes()
    if content not in READ:
        READ[content] = None
        with contextlib.suppress(WorkbenchError):
            READ[content] = hash(read(recording=path).z_mm.tobytes())
    return READ[content]


def recording_left(path: Path) -> list[Path]:
    """Half-written ones."""
    return [*path.parent.glob(f".{path.name}.*"), *path.parent.glob(f".{path.stem}.*partial*")]


def importing(scratch: Path) -> Command:
    """`workbench import` of a small recording's profiles and poses as tables."""
    from workbench.importing.command import import_files

    write_tables(CORPUS / "inspecting" / "small.h5", scratch)
    sources = [scratch / "scan.csv", scratch / "robot.csv"]
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


def acknowledged(place: Path) -> Path:
    """Where the page's writer notes what the store has acknowledged: on a disk that meets no fault."""
    return place.parents[2] / f"{place.parent.name}-{place.name}"


def made(place: Path) -> None:
    """The user's folder, which is there before the page is."""
    from workbench.errors import OutputError

    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(str(place), str(error.strerror)) from None


def store_state(place: Path) -> object:
    """The page's runs and presets; () without any, None where one lacks that was acknowledged, or is not whole."""
    from workbench.page.store import Store

    noted = acknowledged(place)
    promised = noted.read_text().split() if noted.exists() else []
    if not (place / ".workbench" / "store.sqlite").exists():
        return () if not promised else None
    with Store.of(place) as store:
        rows = [(run.inputs["k"], run.state, run.record["k"]) for run in reversed(store.runs())]
        rows += [(preset.name, preset.inputs["k"]) for preset in store.presets()]
    there = {f"{row[0]}{row[1]}" for row in rows} | {f"{row[0]}queued" for row in rows if row[1] == "done"}
    return tuple(rows) if there.issuperset(promised) else None


def write_store(place: Path, runs: int = PAGE_RUNS) -> None:
    """Runs asked for, done and remembered as a preset, each once: what the page does to its store."""
    from workbench.page.store import Preset, Store

    made(place)
    with acknowledged(place).open("a", buffering=1) as acknowledge, Store.of(place) as store:
        for k in range(runs):
            if not store.has({"k": k}):
                store.add("inspect_bevel", {"k": k}, record={"k": k})
            acknowledge.write(f"{k}queued\n")
            store.update(k + 1, state="done", status=0)
            acknowledge.write(f"{k}done\n")
            store.keep(Preset(f"preset{k}", "inspect_bevel", {"k": k}))
            acknowledge.write(f"preset{k}{k}\n")


def paging() -> Command:
    """The store of `workbench open`."""
    return Command(
        "store", write_store, store_state, lambda _: [], partial(write_store, runs=1), between=lambda state: bool(state)
    )


def queue_state(place: Path) -> object:
    """State of the last run that the page's queue was given."""
    from workbench.page.store import Store

    if not (place / ".workbench" / "store.sqlite").exists():
        return ()
    with Store.of(place) as store:
        return tuple((run.kind, run.state) for run in store.runs(most=1))


def write_queue(place: Path) -> None:
    """A look at a small file, asked for unless it was, and waited for."""
    from workbench.errors import OutputError
    from workbench.page.jobs import LOOK, Queue
    from workbench.page.store import Store

    made(place)
    with Store.of(place) as store:
        queue = Queue(store, place)
        try:
            number = next((run.id for run in store.runs()), None)
            if number is None or store.run(number).state != "done":
                number = queue.add(LOOK, {"file": str(CORPUS / "profiles" / "known.csv")})
            until = time.monotonic() + WAIT_S
            while store.run(number).state in ("queued", "running"):
                if time.monotonic() > until:
                    raise RuntimeError(STANDS_STILL)
                time.sleep(0.02)
            if store.run(number).status == 2:
                raise OutputError(str(place), store.run(number).reason)
        finally:
            queue.close()


def queueing() -> Command:
    """The queue of `workbench open`, whose runs are processes of their own."""
    return Command("queue", write_queue, queue_state, lambda _: [], between=lambda state: True)


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
    if fault.kind in LASTING and STANDS_STILL in text:
        return "told"  # by the state that the page shows: it goes on once the disk does
    return {0: "written", ALIVE: "told"}.get(status, f"WRONG: {text[-400:]}")


def _write_and_exit(write: Callable[[Path], object], out: Path, fault: Fault, said: int) -> NoReturn:
    from workbench.errors import WorkbenchError

    status = 3
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(said, 2)
        fault.arm(out.parent.parent)
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
        os.write(writer, str(ctypes.CDLL(None).operations_done()).encode())

    if old:
        in_child(command, place, Fault(), old=True)
    in_child(replace(command, write=counted), place, Fault())
    os.close(writer)
    with os.fdopen(reader) as said:
        return int(said.read())


def case(command: Command, scratch: Path, rng: random.Random) -> Counter[str]:
    """One drawn fault, half of the time over an older set; half of the time another after it; then none."""
    found: Counter[str] = Counter()
    old = rng.random() < 0.5
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        place = Path(folder) / f"out{command.suffix}"
        if old:
            in_child(command, place, Fault(), old=True)
        for _ in range(rng.randint(1, 2)):
            before, left = command.state(place), command.left(place)
            fault = Fault(rng.choice(KINDS), rng.randint(1, command.counts[old]))
            ended = in_child(command, place, fault)
            found[_judged(command, place, before, ended, fault)] += 1
            more = [path for path in command.left(place) if path not in left]
            if ended == "told" and fault.kind == "full disk" and more:
                found[f"BROKEN: {fault.kind} at {fault.at}: left {more}"] += 1
        ended = in_child(command, place, Fault())
        whole = ended == "written" and command.state(place) == command.new and not command.left(place)
        found["the next run works" if whole else f"BROKEN: the next run, {ended}, {command.left(place)}"] += 1
    return found


def _judged(command: Command, place: Path, before: object, ended: str, fault: Fault) -> str:
    after = command.state(place)
    if ended.startswith("WRONG"):
        return f"BROKEN: {fault.kind} at {fault.at}: {ended}"
    if ended == "written" and after != command.new:
        return f"BROKEN: {fault.kind} at {fault.at}: told as written and is not"
    if after is None and command.state is whole_sets and _changing(place):
        return CHANGING
    if after == before and after is not None:
        return OLD if before else NONE
    if after == command.new:
        return NEW
    if after in ("", {}, ()):
        return NONE
    if command.between(after):
        return CHANGING
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
        "store": paging,
        "queue": queueing,
    }


def tried(command: Command, scratch: Path) -> Command:
    """The command run without a fault; all that it needs is loaded then, for the forks."""
    usual = Path(tempfile.mkdtemp(dir=scratch)) / f"out{command.suffix}"
    command.write(usual.with_name(f"first{command.suffix}"))
    counts = operations(command, usual, old=False), operations(command, usual.with_name(f"old{command.suffix}"), True)
    return replace(command, new=command.state(usual), counts=counts)


def drawn(name: str, seconds: float, seeds: range) -> Counter[str]:
    """A command under every seed, for so many seconds, in a process that holds what it needs: forks copy that."""
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(dir=SCRATCH if SCRATCH.is_dir() else None) as folder:
        scratch = Path(folder) / "scratch"
        scratch.mkdir()
        command = tried(commands(scratch)[name](), scratch)
        gc.collect()
        gc.freeze()  # a collection in a forked child would copy every page
        until = time.monotonic() + seconds
        for seed in seeds:
            if time.monotonic() > until:
                break
            ends = case(command, scratch, random.Random(f"{name} {seed}"))
            found += ends
            found["cases"] += 1
            for what in ends:
                if what.startswith("BROKEN"):
                    print(f"{name}, seed {seed}: {what}", flush=True)
    return found


def preloaded(arguments: Sequence[str]) -> int:
    """Begin again with faults.c under libc."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "faults.so"
        source = Path(__file__).with_name("faults.c")
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", made, source, "-ldl"], check=True)
        again = [sys.executable, "-m", "bench.kills", *arguments]
        return subprocess.run(again, env={**os.environ, "LD_PRELOAD": str(made)}, check=False).returncode


def tasks(given: Namespace) -> Iterator[tuple[str, float, range]]:
    """Command, its share of the time, and its seeds, a task a worker."""
    for name in given.only:
        every = QUEUE_EVERY if name == "queue" and len(given.only) > 1 else 1
        first = given.seed + -given.seed % every
        for k in range(given.workers):
            seeds = range(first + k * every, given.seed + given.cases, every * given.workers)
            yield name, given.seconds / len(given.only), seeds


def measured(task: tuple[str, float, range]) -> tuple[str, Counter[str]]:
    """A command, in a process of its own that it may change."""
    return task[0], forked(partial(drawn, *task))


def table(found: Sequence[tuple[str, Counter[str]]], given: Namespace) -> list[str]:
    """A row a command: what stood there after each fault that it met."""
    summed = {name: sum((of for one, of in found if one == name), Counter[str]()) for name in given.only}
    counts = ["cases", *STATES, "the next run works"]
    rows = [[name, *(f"{of[what]:,}" for what in counts), str(broken(of))] for name, of in summed.items()]
    return markdown(["command", *counts, "broken"], rows)


def broken(found: Counter[str]) -> int:
    """How many cases left what must not be."""
    return sum(count for what, count in found.items() if what.startswith("BROKEN"))


STUDY = Study(
    "kills",
    str(__doc__),
    {
        "cases": Option(1_500, "of each command"),
        "only": Option(tuple(commands(Path())), "commands"),
        "seed": Option(1, "of the first case; the next has the next"),
        "seconds": Option(1e9, "at most, shared by the commands, beside the first run of each", said=False),
    },
    tasks,
    measured,
    table,
    "reliability.md",
    "kills",
    told=lambda found: [],
    failed=lambda found: broken(found[1]),
    workers=1,
)
if __name__ == "__main__":
    sys.exit(STUDY() if hasattr(ctypes.CDLL(None), "arm_faults") else preloaded(sys.argv[1:]))
