"""The output directory: one writer at a time, a whole set of results or none, never an earlier run's in their place.

Files are written into a hidden directory beside their final places and renamed when all are complete, `run.json` last
(a set without it is not one). A directory that did not exist appears with one rename. Files that no run has written
stay: a run refuses to replace one. When a run fails, the results that an earlier run left are moved to `superseded/`.
One run at a time.
"""

from __future__ import annotations

import fcntl
import glob
import json
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from workbench.errors import OutputError
from workbench.pipeline.results import RUN_FILE, is_plain_name


class BusyError(Exception):
    """Somebody else holds the lock."""


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock on a directory, or on the file `path`, made for it and removed after it.

    Where the file system knows no locks (some network shares) nothing guards: better than no run.

    Raises:
        BusyError: it is held, also by this process.
        OSError: the file cannot be made.
    """
    descriptor = _open_and_lock(path)
    try:
        yield
    finally:
        if not path.is_dir():
            with suppress(OSError):
                os.unlink(path)
        with suppress(OSError):  # of a device that is gone: the lock is, too
            os.close(descriptor)


def clear_lock(path: Path) -> None:
    """Remove the lock file of a process that was killed; one that is held stays."""
    with suppress(OSError, BusyError):
        if path.is_file():
            with locked(path):
                pass


def _open_and_lock(path: Path) -> int:
    while True:
        flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW
        descriptor = os.open(path, flags, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise BusyError(str(path)) from None
        except OSError:
            return descriptor
        with suppress(FileNotFoundError):  # its last holder may have removed it between opening and locking
            if os.path.samestat(os.stat(path), os.fstat(descriptor)):
                return descriptor
        os.close(descriptor)


OLD = ".old"
MOVING = ".moving"  # in a staged set: it is complete, and its files are changing places


def staged_prefix(target: Path) -> str:
    """How names of staged directories for `target` begin."""
    return f".{target.name}.partial-"


def exchange(staged: Path, target: Path, old: list[str], new: list[str]) -> None:
    """Files `old` of `target` into `staged`, files `new` the other way, in order; OSError: all is as before.

    `staged` holds the new set complete. Names of both sets are written there first; then the old files go out, then the
    new ones come in. No rename is lost: the next run continues where a killed one stopped.
    """
    (staged / MOVING).write_text(json.dumps({"old": old, "new": new}))
    try:
        _change_places(staged, target, old, new)
    except OSError:
        _put_back(staged, target, old, new)
        _moved(staged)
        raise
    _moved(staged)


def clear_killed_runs(target: Path, *, siblings: bool = True) -> None:
    """What killed runs left: a set that was changing places goes all the way, others were never complete.

    `siblings`: a run may have begun before `target` was there, so the folder above is looked through as well.
    """
    for place in (target, target.parent) if siblings else (target,):
        for staged in place.glob(f"{glob.escape(staged_prefix(target))}*"):
            with suppress(FileNotFoundError, ValueError):  # ValueError: killed before the first file moved
                _change_places(staged, target, *_names(staged))
                _moved(staged)
            shutil.rmtree(staged, ignore_errors=True)


def _names(staged: Path) -> tuple[list[str], list[str]]:
    """Old and new ones; FileNotFoundError if nothing was moving, ValueError for what no run wrote."""
    moving = json.loads((staged / MOVING).read_text())
    if not isinstance(moving, dict) or moving.keys() != {"old", "new"}:
        raise ValueError(MOVING)
    old, new = ([name for name in moving[key] if is_plain_name(name)] for key in ("old", "new"))
    return old, new


def _change_places(staged: Path, target: Path, old: list[str], new: list[str]) -> None:
    for name in old:
        if not (staged / f"{name}{OLD}").exists():
            os.rename(target / name, staged / f"{name}{OLD}")
    for name in new:
        if (staged / name).exists():
            os.rename(staged / name, target / name)


def _moved(staged: Path) -> None:
    """The staged directory goes now; the next run must not take what is left of it for a set on its way."""
    (staged / MOVING).unlink()


def _put_back(staged: Path, target: Path, old: list[str], new: list[str]) -> None:
    for name in (name for name in new if not (staged / name).exists()):
        os.rename(target / name, staged / name)
    for name in (name for name in old if (staged / f"{name}{OLD}").exists()):
        os.rename(staged / f"{name}{OLD}", target / name)


# What the contract calls a result, whoever wrote it: a reader takes these for the last run's.
RESULT_NAMES = (
    RUN_FILE,
    "inspection.json",
    "toolpath.json",
    "handeye.json",
    "stiffness.json",
    "posture.json",
    "report.html",
)
PROBE_BYTES = 1_000_000
SUPERSEDED = "superseded"


class ForeignFileError(OutputError):
    """A file that no run has written stands in the place of a result: it stays."""

    supersedes = False


class OutputDirectory:
    """Where one run's results go. Every failure is an OutputError that names the directory."""

    def __init__(self, path: str | Path, *, exists: bool = False) -> None:
        """`exists`: no run writes there before the directory has been made; the one above may hold millions."""
        if not str(path):
            raise OutputError("''", "expected the name of a directory ('.' for this one)")
        self.path, self._exists = Path(path), exists

    @contextmanager
    def reserved(self, inputs: Iterable[Path] = ()) -> Iterator[None]:
        """For the length of a run: does it take files, or can it be made? Nobody else writes there meanwhile.

        inputs: paths of files that the run reads.
        """
        with self._errors():
            place = self._place()
            with tempfile.TemporaryFile(dir=place) as probe:
                probe.write(bytes(PROBE_BYTES))
        with self._held(place):
            with self._errors(), _signals_wait():
                clear_killed_runs(self.path, siblings=not self._exists)
                if place == self.path and not self._exists:
                    clear_lock(self._sibling_lock(self.path.parent))
                self._refuse_foreign(RESULT_NAMES)
                self._refuse_own(inputs)
            yield

    def publish(self, files: Mapping[str, bytes], *, over: str = "") -> tuple[Path, ...]:
        """Write `files` (run.json among them) as the directory's one set of results.

        `over`: a file that is replaced although no run.json lists it.
        """
        with self._errors(), _signals_wait():
            self._refuse_foreign(name for name in files if name != over)
            if not self.path.is_dir():
                self.path.parent.mkdir(parents=True, exist_ok=True)
            place = self.path if self.path.is_dir() else self.path.parent
            staged = Path(tempfile.mkdtemp(prefix=staged_prefix(self.path), dir=place))
            try:
                for name, content in files.items():
                    with (staged / name).open("wb") as file:
                        file.write(content)
                        file.flush()
                        os.fsync(file.fileno())  # a rename may reach the disk before what it names
                staged.chmod(0o777 & ~_umask())
                self._move_in(staged, sorted(files, key=lambda name: name == RUN_FILE))
            finally:
                shutil.rmtree(staged, ignore_errors=True)
        return tuple(self.path / name for name in files)

    def supersede(self) -> Path | None:
        """Move an earlier run's results aside, into `superseded/N/`; None if there are none."""
        with self._errors():
            if not self.path.is_dir():
                return None
        with self._held(self.path), self._errors(), _signals_wait():
            clear_killed_runs(self.path, siblings=not self._exists)
            old = self._results()
            if not old:
                return None
            (self.path / SUPERSEDED).mkdir(exist_ok=True)
            taken = [int(p.name) for p in (self.path / SUPERSEDED).iterdir() if p.name.isdecimal()]
            folder = self.path / SUPERSEDED / str(max(taken, default=0) + 1)
            folder.mkdir()
            for name in sorted(old, key=lambda name: name == RUN_FILE):  # killed before that: the rest is still known
                os.rename(self.path / name, folder / name)
            return folder

    @contextmanager
    def _held(self, place: Path) -> Iterator[None]:
        """The lock: on the directory, or beside its place where it does not exist yet."""
        lock = place if place == self.path else self._sibling_lock(place)
        with ExitStack() as held:
            try:
                with self._errors():
                    held.enter_context(locked(lock))
            except BusyError:
                why = "another run is writing there; wait for it, or choose another --out"
                raise OutputError(str(self.path), why) from None
            yield

    def _sibling_lock(self, place: Path) -> Path:
        return place / f".{self.path.name}.lock"

    def _place(self) -> Path:
        """The nearest directory that exists, from the output directory upwards; a file on the way is refused."""
        for place in (self.path, *self.path.absolute().parents):
            try:
                os.lstat(place)
            except (FileNotFoundError, NotADirectoryError):
                continue
            if place.is_dir():
                return place
            raise OutputError(str(place), "is not a directory")
        raise OutputError(str(self.path), "has no directory above it")

    def _move_in(self, staged: Path, names: list[str]) -> None:
        """Change places: the whole directory by one rename where there was none, else file by file."""
        if staged.parent != self.path:
            os.rename(staged, self.path)
            return
        for name in names:
            if (self.path / name).is_dir():
                raise OutputError(str(self.path / name), "is a directory in the place of a result")
        exchange(staged, self.path, self._there(self._listed()), names)

    def _results(self) -> list[str]:
        """Names of the results that stand there: those that its run.json lists; without one, the contract's."""
        return self._there(self._listed() or RESULT_NAMES)

    def _there(self, names: Iterable[str]) -> list[str]:
        return [name for name in dict.fromkeys(names) if (self.path / name).is_file()]

    def _listed(self) -> list[str]:
        """Names that an earlier run.json lists, its own among them; none without one."""
        try:
            listed = json.loads((self.path / RUN_FILE).read_bytes())["files"]
        except (FileNotFoundError, IsADirectoryError, ValueError, TypeError, LookupError, RecursionError):
            return []
        return [RUN_FILE, *filter(is_plain_name, listed)] if isinstance(listed, list) else []

    def _refuse_foreign(self, names: Iterable[str]) -> None:
        for name in set(self._there(names)) - set(self._listed()):
            raise ForeignFileError(
                str(self.path / name),
                "no run has written it (no run.json lists it), and it would pass for a result of this one; move it, or "
                "choose another --out",
            )

    def _refuse_own(self, inputs: Iterable[Path]) -> None:
        """A result of the run before that this one reads: it would go with that run's set."""
        own = {(self.path / name).resolve() for name in self._there(self._listed())}
        for path in inputs:
            if path.resolve() in own:
                why = "is a result of the run before in this --out, which goes with it; choose another --out"
                raise ForeignFileError(str(path), why)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or str(error)
            raise OutputError(str(self.path), f"cannot be written: {why}") from None


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Hold back interruptions for the moment in which files change places."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, held)


def _umask() -> int:
    mask = os.umask(0o22)
    os.umask(mask)
    return mask
