"""A batch: one run per part, then the page of the fleet."""

from __future__ import annotations

import glob
import os
import re
import time
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple, TextIO, TypedDict, Unpack

from rich.console import Console
from rich.table import Table
from rich.text import Text

from workbench.artefacts.showing import shown
from workbench.batch.part import OUTCOMES, RECORDING, Job, Record
from workbench.batch.store import is_remote, joined, listed, local_path, refuse_credentials, write_file
from workbench.batch.workers import Workers, here
from workbench.errors import InputError, OutputError, PipelineError, nearest, one_line
from workbench.extras import require
from workbench.geometry.blocks import cores
from workbench.pipeline.document import PipelineDocument, read_document
from workbench.pipeline.output import BusyError, locked
from workbench.pipeline.wiring import plan

# From what stands on the command line to parts: each recording's place, and the name of the folder of its results.

LONGEST = 100  # characters of a name; file systems take 255 bytes
TAKEN = ("fleet.html", "fleet.parquet", "superseded")  # what the folder of a batch holds beside its parts
SUFFIX = ".h5"


class Part(NamedTuple):
    """One part: `name` is that of its folder, `recording` a path or URL as given."""

    name: str
    recording: str


def parts(recordings: Iterable[str]) -> tuple[Part, ...]:
    """The parts of these recordings, in the order given: that is taken as the order of production.

    A folder stands for the recordings (`.h5`) in it, a path or URL may hold wildcards: in the order of their names,
    numbers by value.

    Raises:
        InputError: none; one given twice; two whose folders would have the same name.
    """
    found = [Part(safe_name(one), one) for given in recordings for one in _expanded(given)]
    if not found:
        raise InputError("recordings", "expected at least one")
    known: dict[str, Part] = {}
    for part in found:
        key = part.name.casefold()  # some file systems know no case
        if key in known and _same(known[key].recording, part.recording):
            raise InputError(part.recording, "is given twice")
        if key in known:
            raise InputError(
                part.recording,
                f"its results would go into the folder '{part.name}', as those of "
                f"{known[key].recording}: expected file names that differ",
            )
        known[key] = part
    return tuple(found)


def _there(part: Part) -> bool:
    """Whether a recording is there; of one behind a URL its run tells."""
    return is_remote(part.recording) or Path(local_path(part.recording)).exists()


def safe_name(recording: str) -> str:
    """The file's name without its ending, as a folder's: letters, digits, '.', '-' and '_'; never hidden or a path."""
    file = PurePosixPath(recording.rstrip("/")).name if is_remote(recording) else Path(local_path(recording)).name
    stem = unicodedata.normalize("NFC", file.removesuffix(SUFFIX))
    name = "".join(c if c.isalnum() or c in "-_." else "_" for c in stem)[:LONGEST].strip(".")
    if not name or name.casefold() in TAKEN:
        raise InputError(recording, "expected a file name that a folder can be called after")
    return name


def _expanded(given: str) -> list[str]:
    """The recordings that one argument stands for."""
    if is_remote(given):
        refuse_credentials(given)
        return sorted(listed(given, SUFFIX), key=by_numbers)
    folder = Path(local_path(given))
    if folder.is_dir():
        found, where = [str(path) for path in folder.iterdir() if path.suffix == SUFFIX], "in this folder"
    elif glob.has_magic(given) and not folder.exists():  # quoted, or the shell has found none
        found, where = glob.glob(str(folder)), "by this name"
    else:
        return [given]
    if not found:
        raise InputError(given, f"expected recordings (*{SUFFIX}) {where}, found none")
    return sorted(found, key=by_numbers)


def by_numbers(name: str) -> list[tuple[int, int, str]]:
    """A key that sorts part-2 before part-10."""
    return [(0, int(piece), "") if piece.isdecimal() else (1, 0, piece) for piece in re.split(r"(\d+)", name) if piece]


def _same(one: str, other: str) -> bool:
    if is_remote(one) or is_remote(other):
        return one == other
    return Path(local_path(one)).resolve() == Path(local_path(other)).resolve()


TIME_LIMIT_S = 600.0
# And what those that a batch has written have in them.
FLEET_FILES = {"fleet.html": b"<title>Fleet: ", "fleet.parquet": b"section_verdict"}


@shown
@dataclass(frozen=True, slots=True)
class Batch:
    """What became of the parts, in the order given."""

    records: tuple[Record, ...]
    out: str
    files: tuple[str, ...]

    @property
    def exit_status(self) -> int:
        """0: every part passed the gate; 1: some were rejected; 2: some have no results."""
        if self.without_results:
            return 2
        return int(any(record.outcome == "rejected" for record in self.records))

    @property
    def without_results(self) -> tuple[Record, ...]:
        """Parts that have none, in order."""
        return tuple(record for record in self.records if record.outcome not in ("passed", "rejected"))

    @property
    def failure(self) -> str:
        """The first part without results, its recording and the cause, and how many there are."""
        first, count = self.without_results[0], len(self.without_results)
        named = first.cause if first.recording in first.cause else f"{first.recording}: {first.cause}"
        return f"{named} ({count} of {len(self.records)} parts have no results)"


class Alike(TypedDict, total=False):
    """What is the same for all parts of a batch."""

    inputs: Mapping[str, Any] | None  # as `Pipeline.run` takes them
    settings: Mapping[str, Any] | None  # likewise
    cache: str | None  # folder that keeps copies of recordings behind URLs; None: they are dropped after their part
    report: bool  # whether each part gets its report.html


def run_batch(
    pipeline: str | Path,
    recordings: Iterable[str],
    out: str,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    time_limit_s: float = TIME_LIMIT_S,
    progress: TextIO | None = None,
    **alike: Unpack[Alike],
) -> Batch:
    """Run a pipeline once for each recording: results in `out`/PART/, the fleet in `out`/fleet.html and fleet.parquet.

    A part whose whole results of the same inputs, pipeline and versions stand there is skipped. A part that cannot be
    used, takes longer than `time_limit_s` or kills its process is recorded with its cause and stops no other.

    Args:
        pipeline: its file; it must have an input `recording`.
        recordings: paths, folders or URLs, in the order of production.
        out: folder or URL.
        workers: processes on this machine, as many as cores by default; 0: in this process, without time limit.
        scheduler: address of a dask.distributed scheduler, `tcp://HOST:PORT`, to use instead.
        time_limit_s: for each part.
        progress: stream that is told how far the batch is.
        alike: what is the same for all parts: `inputs`, `settings`, `cache`, `report`.

    Raises:
        WorkbenchError: the arguments, the pipeline or `out` cannot be used, before anything runs.
    """
    require("pyarrow")  # for the fleet, when all parts are done
    document = read_document(Path(pipeline))
    check(document, alike.get("inputs") or {}, alike.get("settings") or {})
    found = parts(recordings)
    if scheduler is None and not any(map(_there, found)):
        raise InputError(found[0].recording, "no such file")
    jobs = [_job(part, document, out, alike) for part in found]
    with ExitStack() as connected:  # a scheduler that does not answer leaves `out` as it is
        execute = connected.enter_context(executor(workers, scheduler, time_limit_s, len(jobs)))
        with _reserved(out), connected.pop_all():  # ended before the folder is free again
            done = {one.part: one for one in Progress(len(jobs), progress).watched(execute(jobs))}
            records = tuple(done[part.name] for part in found)
            return Batch(records, out, write_fleet(records, document.title, out))


def check(document: PipelineDocument, inputs: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
    """All that can be checked for all parts at once: any readable file stands for the recording."""
    if RECORDING not in document.inputs:
        where = f"{document.name}: inputs"
        raise PipelineError(where, f"a batch needs an input '{RECORDING}'{nearest(RECORDING, document.inputs)}")
    if RECORDING in inputs:
        raise PipelineError(f"input '{RECORDING}'", "differs from part to part: give the recordings as arguments")
    plan(document, {**inputs, RECORDING: os.devnull}, settings)


@contextmanager
def executor(workers: int | None, scheduler: str | None, time_limit_s: float, jobs: int) -> Iterator[Any]:
    """A function from jobs to records as they are done."""
    if scheduler is not None:
        from workbench.batch.workers import Cluster  # needs the extra `cluster`

        with Cluster(scheduler, time_limit_s=time_limit_s) as cluster:
            yield cluster.run
    elif workers == 0:
        yield here
    else:
        with Workers(min(workers or cores(), jobs), time_limit_s=time_limit_s) as local:
            yield local.run


def write_fleet(records: tuple[Record, ...], title: str, out: str) -> tuple[str, ...]:
    """`fleet.html` and `fleet.parquet`."""
    from workbench.batch.fleet import fleet_files

    files = fleet_files(records, title)
    for name, content in files.items():
        write_file(out, name, content)
    return tuple(joined(out, name) for name in files)


def _job(part: Part, document: PipelineDocument, out: str, alike: Alike) -> Job:
    return Job(
        part.name,
        part.recording,
        document,
        alike.get("inputs") or {},
        alike.get("settings") or {},
        joined(out, part.name),
        os.getcwd(),
        alike.get("cache"),
        alike.get("report", True),
    )


@contextmanager
def _reserved(out: str) -> Iterator[None]:
    """One batch at a time in a folder of this machine; no earlier batch's page stands for this one's."""
    if is_remote(out):
        refuse_credentials(out)
        yield
        return
    folder = Path(local_path(out))
    with ExitStack() as held:
        try:
            if not out:
                raise OutputError("''", "expected the name of a folder ('.' for this one)")
            folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(locked(folder))
            old = [folder / name for name in FLEET_FILES if (folder / name).exists()]
            for path in old:
                if FLEET_FILES[path.name] not in path.read_bytes():
                    why = "no batch has written it, and this one would; move it, or choose another --out"
                    raise OutputError(str(path), why)
            for path in old:
                path.unlink()
        except BusyError:
            raise OutputError(out, "another batch is writing there; wait for it, or choose another --out") from None
        except OSError as error:
            raise OutputError(out, f"cannot be written: {error.strerror}") from None
        yield


# How far a batch is, on standard error: one line, rewritten on a terminal, else told now and then.

EVERY_S = 10.0  # between lines where none can be rewritten


class Progress:
    """Counts records as they come."""

    def __init__(self, total: int, stream: TextIO | None) -> None:
        self.total, self.stream = total, stream
        self.live = stream is not None and stream.isatty()
        self.counts: Counter[str] = Counter()
        self.skipped = 0
        self.started_s = self.reported_s = time.monotonic()

    def watched(self, records: Iterable[Record]) -> Iterator[Record]:
        """The same records, reported as they pass."""
        try:
            for record in records:
                self.counts[record.outcome] += 1
                self.skipped += record.skipped
                self._report(last=self.counts.total() == self.total)
                yield record
        finally:
            if self.live:
                self._write("\n")

    def line(self, elapsed_s: float) -> str:
        """Parts done, what became of them, and the time left at the rate of those that were run."""
        done = self.counts.total()
        words = [f"{self.counts[one]} {one}" for one in reversed(OUTCOMES) if self.counts[one]]
        if self.skipped:
            words.append(f"{self.skipped} of them from an earlier run")
        ran = done - self.skipped
        if done < self.total and ran:
            words.append(f"{duration((self.total - done) * elapsed_s / ran)} left")
        elif done == self.total:
            words.append(f"took {duration(elapsed_s)}")
        return f"[{done}/{self.total}] {', '.join(words)}"

    def _report(self, last: bool) -> None:
        now_s = time.monotonic()
        if self.live:
            self._write(f"\r\033[K{self.line(now_s - self.started_s)}")
        elif last or now_s - self.reported_s >= EVERY_S:
            self.reported_s = now_s
            self._write(f"{self.line(now_s - self.started_s)}\n")

    def _write(self, text: str) -> None:
        if self.stream:
            with suppress(OSError):  # a batch does not fail because nobody can watch it
                self.stream.write(text)
                self.stream.flush()


def duration(seconds: float) -> str:
    """A time in words, in the units that fit it."""
    if seconds < 60:
        return f"{seconds:.0f} s" if seconds >= 1 else f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


SHOWN = 20
COLOURS = {"passed": "green", "rejected": "red"}


def print_batch(made: Batch) -> None:
    """The parts that did not pass, worst first; the counts; the files."""
    from workbench.batch.fleet import worst_first  # which the page has loaded

    console = Console(highlight=False)
    worth = [record for record in worst_first(made.records) if record.outcome != "passed" or record.verdict != "pass"]
    if worth:
        console.print(_table(worth[:SHOWN]))
    if len(worth) > SHOWN:
        console.print(f"and {len(worth) - SHOWN} more, in the page")
    console.print(Text(one_line(summary(made.records))), soft_wrap=True)
    for file in made.files:
        console.print(Text(one_line(f"wrote: {file}")), soft_wrap=True)


def summary(records: tuple[Record, ...]) -> str:
    """Parts by outcome, and by verdict where there is one."""
    words = [f"{len(records)} parts"]
    counts = [(sum(record.outcome == kind for record in records), kind) for kind in OUTCOMES]
    words += [f"{count} {kind}" for count, kind in counts if count]
    verdicts = [record.verdict for record in records if record.verdict]
    tally = ", ".join(f"{verdicts.count(one)} {one}" for one in ("fail", "undecided", "pass") if one in verdicts)
    return ", ".join(words) + (f" (verdicts: {tally})" if tally else "") + _again(records)


def _again(records: tuple[Record, ...]) -> str:
    """How many are of an earlier run, and how many have the part number of one before."""
    skipped, numbers = sum(record.skipped for record in records), [one.part_id for one in records if one.part_id]
    alike = len(numbers) - len(set(numbers))
    earlier = f"; {skipped} from an earlier run" if skipped else ""
    return earlier + (f"; {alike} with the part number of another" if alike else "")


def _table(records: list[Record]) -> Table:
    table = Table("part", "outcome", "verdict", "cause")
    for record in records:
        outcome = Text(record.outcome, COLOURS.get(record.outcome, "bold red"))
        table.add_row(Text(one_line(record.part)), outcome, record.verdict or "", Text(one_line(record.cause)))
    return table
