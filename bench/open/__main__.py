"""`python -m bench.open`: every rival over the recordings of every track, one table, best first.

`--write FOLDER` writes the recordings for other people's programs instead, `--new-round VERSION` seals the next round.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.harness import Option, Study
from bench.open.rivals import FROZEN, NAMES, rival
from bench.open.table import pictured, summary, table
from bench.open.tracks import FORMATS, ROUNDS, TRACKS, Entry, drawn, entries, keys, rounds, truth, write
from bench.score.parts import kept
from workbench.score.judge import judged

QUICK = 7  # recordings of each set
Task = tuple[str, Entry, tuple[str, ...], str]  # track, recording, rivals, folder of drawn recordings
Answers = Mapping[str, Mapping[str, Any]]  # by rival


def sets(given: Namespace) -> dict[tuple[str, str], list[Entry]]:
    """Recordings by track and set."""
    secret = Path(given.key).read_text(encoding="utf-8").strip() if given.key else None
    return {
        (track, name): entries(track, name, key)[: QUICK if given.quick else None]
        for track in given.tracks
        for name, key in keys(given.version, secret).items()
    }


def tasks(given: Namespace) -> Iterator[Task]:
    """Every recording with all rivals of its track."""
    for (track, _), some in sets(given).items():
        names = tuple(name for name in given.rivals if track in rival(name).tracks)
        yield from ((track, entry, names, given.keep or str(kept())) for entry in some)


def answered(task: Task) -> Answers:
    """What every rival says of a recording."""
    _, entry, names, keep = task
    part, told = drawn(entry, Path(keep)), {}
    for name in names:
        start = time.process_time()
        try:
            answer = dict(rival(name).measure(part.recording, part.declared))
        except Exception as error:  # a rival that fails has refused; the others go on
            answer = {"refused": f"{type(error).__name__}: {error}"[:300]}
        told[name] = answer | {"seconds": round(time.process_time() - start, 3)}
    return told


def report(found: Sequence[Answers], given: Namespace) -> Iterator[str]:
    """The table, and with `--docs` its pictures."""
    told = list(zip(tasks(given), found, strict=True))
    cards = {track: cards_of(track, [one for one in told if one[0][0] == track], given) for track in given.tracks}
    yield f"Round {given.version}, sets {' and '.join(dict.fromkeys(name for _, name in sets(given)))}."
    yield from ("", table(cards))
    if given.docs:
        pictured(cards)


def cards_of(track: str, told: Sequence[tuple[Task, Answers]], given: Namespace) -> list[dict[str, Any]]:
    """A card a rival, over all sets together; submissions of whom only results are kept among them."""
    parts = {entry.name: drawn(entry, Path(keep)) for (_, entry, _, keep), _ in told}
    true = truth(given.version, track, "all", parts)
    submissions = {
        name: {
            "format": "edge-benchmark-submission",
            "version": 1,
            "method": rival(name).title,
            "track": track,
            "recordings": {task[1].name: one[name] for task, one in told},
        }
        for name in told[0][0][2]
    }
    for path in sorted(FROZEN.glob(f"{track}-*-{given.version}.json")):
        submissions[path.stem] = json.loads(path.read_text(encoding="utf-8"))
    for name, document in submissions.items():
        if given.submissions:
            path = Path(given.submissions, f"{track}-{name}.json")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(document), encoding="utf-8")
        # frozen results may be of more recordings than a quick look has
        document["recordings"] = {name: answer for name, answer in document["recordings"].items() if name in parts}
    return sorted((judged(document, true) for document in submissions.values()), key=lambda card: card["score"])


def written(given: Namespace) -> bool:
    """Whether recordings were to be written, or a round to be sealed, instead of measuring."""
    if given.new_round:
        seal(given.new_round, Path(given.key))
    elif given.write:
        for (track, name), some in sets(given).items():
            parts = {one.name: drawn(one, Path(given.keep or kept())) for one in some}
            folder = Path(given.write, track, name)
            write(folder, parts, tuple(given.formats))
            (folder / "truth.json").write_text(json.dumps(truth(given.version, track, name, parts)), encoding="utf-8")
    return bool(given.new_round or given.write)


def seal(version: str, key: Path) -> None:
    """A new round: the key goes to a file that must stay apart, its digest into rounds.json."""
    if version in rounds() or key.exists():
        raise SystemExit(f"round {version} or the file {key} is there already")
    secret = os.urandom(24).hex()  # that nobody can guess
    key.write_text(secret + "\n", encoding="utf-8")
    digest = hashlib.sha256(secret.encode()).hexdigest()
    ROUNDS.write_text(
        json.dumps({**rounds(), version: {"key_sha256": digest, "key": None, "opened": None}}, indent=1) + "\n"
    )


STUDY = Study(
    "open",
    str(__doc__),
    {
        "version": Option(next(iter(rounds())), "round", rounds()),
        "tracks": Option(tuple(TRACKS), choices=TRACKS),
        "rivals": Option(NAMES, choices=NAMES),
        "quick": Option(False, f"{QUICK} recordings of each set: five minutes"),
        "keep": Option("", "folder of drawn recordings", said=False),
        "key": Option("", "file with the key of a sealed round", said=False),
        "write": Option("", "folder for recordings, what is declared, and truth"),
        "formats": Option(("h5",), "of --write", FORMATS),
        "submissions": Option("", "folder for what each rival answered", said=False),
        "new_round": Option("", "its version: draw a key into the file --key, publish its digest"),
    },
    tasks,
    answered,
    report,
    "benchmark.md",
    "benchmark",
    summary,
    instead=written,
)
if __name__ == "__main__":
    sys.exit(STUDY())
