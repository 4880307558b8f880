"""`python -m bench.kills.disk`: recordings written to places that fill up, at random moments; what was left of each.

Forked children run `simulate` and `import` where (a) a limit on the size of files stands in for a quota, (b) a small
file system (tmpfs) is filled by this process before or while they write, (c) the same, but room cannot be taken first,
so that single writes fail. A child may write both files whole, or end with status 2, one line and nothing changed.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from workbench.cli import main as workbench

DISK_BYTES = 4_000_000
ROOMS_BYTES = 2_400_000, 100_000  # twice what either command takes before it writes, and what it leaves in the end
PAUSE_S = 0.1  # about what a command takes
FRAMES, COLUMNS = 150, 120
RECIPE = {"part": {"length_mm": 40}, "scanner": {"columns": COLUMNS}, "passes": [{"from_mm": 2, "to_mm": 38}]}
MAPPING = {
    "format": "import-mapping",
    "version": 1,
    "linear_axis": {"direction": [0, 1, 0]},
    "times": {"source": "travel", "start_mm": 0, "pitch_mm": 0.5},
}


@contextlib.contextmanager
def small_disk(place: Path) -> Iterator[Path | None]:
    """A file system of DISK_BYTES at `place`; None where none may be mounted."""
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        mounted = False
    try:
        yield place if mounted else None
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(place)], check=True)


def writes(count: int, seed: int, folder: Path) -> Counter[str]:
    """How `count` writes ended; what must not be starts with WRONG."""
    rng = random.Random(seed)
    sources = folder / "sources"
    sources.mkdir()
    commands = [_simulate(sources), _import(sources, rng)]
    found: Counter[str] = Counter()
    plain = folder / "plain"
    plain.mkdir()
    with small_disk(folder / "small") as disk:
        obstacles = [_quota, _filled, _filled_late] if disk else [_quota]
        for command in commands:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
                if workbench([*command, "--out", str(plain / "part.h5")]) != 0:  # all is loaded once, for the forks
                    raise RuntimeError(said.getvalue())
        for k in range(count):
            obstacle = obstacles[k % len(obstacles)]
            name = obstacle.__name__.strip("_")
            place = plain if obstacle is _quota else disk
            assert place is not None
            found[f"{name}: {_one(rng.choice(commands), place, obstacle, rng)}"] += 1
    return found


def _simulate(folder: Path) -> list[str]:
    recipe = folder / "recipe.json"
    recipe.write_text(json.dumps(RECIPE))
    return ["simulate", str(recipe)]


def _import(folder: Path, rng: random.Random) -> list[str]:
    table = [",".join(f"{rng.gauss(100, 0.02):.5f}" for _ in range(COLUMNS)) for _ in range(FRAMES)]
    rows = [f"{k},{k / 100},{j * 0.1:.1f},{z}" for k, line in enumerate(table) for j, z in enumerate(line.split(","))]
    (folder / "scan.csv").write_text("frame,time_s,x_mm,z_mm\n" + "\n".join(rows))
    (folder / "map.json").write_text(json.dumps(MAPPING))
    return ["import", str(folder / "scan.csv"), "--mapping", str(folder / "map.json")]


Obstacle = Callable[[Path, random.Random], tuple[Callable[[], None], Callable[[], None]]]


def _quota(place: Path, rng: random.Random) -> tuple[Callable[[], None], Callable[[], None]]:
    most = rng.randrange(rng.choice(ROOMS_BYTES))
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)), lambda: None


def _filled(place: Path, rng: random.Random) -> tuple[Callable[[], None], Callable[[], None]]:
    """By another process, before or while the command writes, but for a drawn rest."""
    late, rest = rng.uniform(0, 2 * PAUSE_S) * (rng.random() < 0.7), rng.randrange(rng.choice(ROOMS_BYTES))
    ended = threading.Event()

    def fill() -> None:
        ended.wait(late)
        with contextlib.suppress(OSError), (place / "ballast").open("wb", buffering=0) as ballast:
            left = max(0, os.statvfs(place).f_bavail * os.statvfs(place).f_frsize - rest)
            ballast.write(bytes(left))

    other = threading.Thread(target=fill)
    other.start()

    def tidy() -> None:
        ended.set()
        other.join()
        (place / "ballast").unlink(missing_ok=True)

    if not late:
        other.join()
    return lambda: None, tidy


def _filled_late(place: Path, rng: random.Random) -> tuple[Callable[[], None], Callable[[], None]]:
    """As `_filled`, where a file system cannot take room first: the writes themselves fail."""
    _, tidy = _filled(place, rng)

    def prepare() -> None:
        del os.posix_fallocate
        os.statvfs = lambda _: os.statvfs_result((4096, 4096, *[10**9] * 6, 0, 255))  # type: ignore[assignment, arg-type]

    return prepare, tidy


def _one(command: list[str], place: Path, obstacle: Obstacle, rng: random.Random) -> str:
    """Half of the time over an older recording, which stays where the new one fails."""
    for path in place.iterdir():
        path.unlink()
    out = place / "part.h5"
    if rng.random() < 0.5:
        out.write_bytes(b"an older recording")
        (place / "part.truth.json").write_text("its truth")
    before = _content(place)
    prepare, tidy = obstacle(place, rng)
    try:
        status, said = _ended([*command, "--out", str(out)], place, prepare)
    finally:
        tidy()
    return f"{command[0]} {_judged(status, said, before, _content(place))}"


def _judged(status: int, said: str, before: dict[str, bytes], after: dict[str, bytes]) -> str:
    told = [line for line in said.splitlines() if not line.startswith("[")]
    if status < 0:
        return f"WRONG: signal {-status}"
    if "Traceback" in said or "Exception ignored" in said:
        return "WRONG: a traceback"
    if status == 0:
        bound = json.loads(after["part.truth.json"]) if after.get("part.truth.json", b"its")[:1] == b"{" else {}
        digest = hashlib.sha256(after["part.h5"]).hexdigest()
        return "written" if bound.get("recording_sha256", digest) == digest else "WRONG: truth of another recording"
    if status != 2 or len(told) != 1 or not told[0].startswith("error: ") or len(told[0]) > 300:
        return f"WRONG: status {status}, said {told}"
    return "refused" if after == before else "WRONG: something left or changed"


def _content(place: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in place.iterdir() if path.name != "ballast"}


def _ended(arguments: list[str], place: Path, prepare: Callable[[], None]) -> tuple[int, str]:
    """Exit status of the command in a fork, negative for a signal, and its standard error."""
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if child == 0:
            status = 70
            try:
                os.dup2(said.fileno(), 2)
                os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
                sys.stderr = io.TextIOWrapper(io.FileIO(2, "w", closefd=False))
                prepare()
                status = workbench(arguments)
                sys.stderr.flush()
            except BaseException:
                import traceback

                traceback.print_exc()
                sys.stderr.flush()
            finally:
                os._exit(status)
        _, ended = os.waitpid(child, 0)
        said.seek(0)
        text = said.read().decode(errors="replace")
    return (-os.WTERMSIG(ended) if os.WIFSIGNALED(ended) else os.WEXITSTATUS(ended)), text


def main() -> int:
    """Write, look, count."""
    parser = argparse.ArgumentParser(prog="python -m bench.kills.disk", description=__doc__)
    parser.add_argument("--writes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = writes(options.writes, options.seed, Path(folder))
    for what, count in sorted(found.items()):
        print(f"{count:5} x {what}")
    return int(any("WRONG" in what for what in found))


if __name__ == "__main__":
    sys.exit(main())
