"""`python -m bench.open`: every rival over the recordings of every track, one table, best first.

`--write FOLDER` writes the recordings for other people's programs instead, `--new-round VERSION` seals the next round.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from pathlib import Path
from typing import Any

from bench.harness import made_by
from bench.open.rivals import FROZEN, NAMES, rival
from bench.open.run import answers
from bench.open.table import put, table
from bench.open.tracks import ROUNDS, TRACKS, Entry, drawn, entries, keys, new_round, rounds, truth, write
from bench.score.parts import kept
from workbench.score.judge import judged
from workbench.score.page import picture

QUICK = 7  # recordings of each set


def main(arguments: list[str] | None = None) -> int:
    given = parse(arguments)
    if given.new_round:
        return seal(given.new_round, given.key)
    made = made_by() if given.docs else ""  # of the code that runs: the commit may change meanwhile
    secret = given.key.read_text(encoding="utf-8").strip() if given.key else None
    chosen = keys(given.version, secret)
    sets = {
        (track, name): entries(track, name, key)[: QUICK if given.quick else None]
        for track in given.tracks
        for name, key in chosen.items()
    }
    if given.write:
        for (track, name), some in sets.items():
            parts = {one.name: drawn(one, given.keep) for one in some}
            folder = given.write / track / name
            write(folder, parts, tuple(given.formats))
            (folder / "truth.json").write_text(json.dumps(truth(given.version, track, name, parts)), encoding="utf-8")
        return 0
    tasks = [
        (track, one, tuple(n for n in given.rivals if track in rival(n).tracks), given.keep or kept())
        for (track, _), some in sets.items()
        for one in some
    ]
    found = answers(tasks, given.workers)
    cards = {track: cards_of(track, sets, found, given) for track in given.tracks}
    words = f"python -m bench.open --version {given.version}{' --quick' * given.quick}"
    text = f"`{words}`, sets {' and '.join(chosen)}{made}\n\n{table(cards)}"
    print(text)
    if given.docs:
        put(text, {track: picture(some) for track, some in cards.items()})
    return 0


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.open", description=__doc__)
    parser.add_argument("--version", choices=rounds(), default=next(iter(rounds())), help="round")
    parser.add_argument("--tracks", nargs="+", choices=TRACKS, default=list(TRACKS))
    parser.add_argument("--rivals", nargs="+", choices=NAMES, default=list(NAMES))
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} recordings of each set: five minutes")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    parser.add_argument("--keep", type=Path, help="folder of drawn recordings")
    parser.add_argument("--key", type=Path, help="file with the key of a sealed round")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write recordings, what is declared, and truth")
    parser.add_argument("--formats", nargs="+", choices=("h5", "npz", "csv"), default=["h5"], help="of --write")
    parser.add_argument("--submissions", type=Path, metavar="FOLDER", help="write what each rival answered")
    parser.add_argument("--new-round", metavar="VERSION", help="draw a key into the file --key, publish its digest")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/benchmark.md")
    return parser.parse_args(arguments)


def seal(version: str, key: Path) -> int:
    """A new round: the key goes to a file that must stay apart, its digest into rounds.json."""
    if version in rounds() or key.exists():
        raise SystemExit(f"round {version} or the file {key} is there already")
    secret = new_round()
    key.write_text(secret + "\n", encoding="utf-8")
    digest = hashlib.sha256(secret.encode()).hexdigest()
    ROUNDS.write_text(
        json.dumps({**rounds(), version: {"key_sha256": digest, "key": None, "opened": None}}, indent=1) + "\n"
    )
    return 0


def cards_of(
    track: str,
    sets: dict[tuple[str, str], list[Entry]],
    found: dict[tuple[str, str, str], Any],
    given: argparse.Namespace,
) -> list[dict[str, Any]]:
    """A card a rival, over all sets together; submissions of whom only results are kept among them."""
    parts = {one.name: drawn(one, given.keep) for (of, _), some in sets.items() if of == track for one in some}
    true = truth(given.version, track, "all", parts)
    submissions = []
    for name in given.rivals:
        if track in rival(name).tracks:
            recordings = {entry: found[track, entry, name] for entry in parts}
            submissions.append((name, submission(rival(name).title, track, recordings)))
    for path in sorted(FROZEN.glob(f"{track}-*-{given.version}.json")):
        submissions.append((path.stem, json.loads(path.read_text(encoding="utf-8"))))
    if given.submissions:
        given.submissions.mkdir(parents=True, exist_ok=True)
        for name, document in submissions:
            (given.submissions / f"{track}-{name}.json").write_text(json.dumps(document), encoding="utf-8")
    for _, document in submissions:  # frozen results may be of more recordings than a quick look has
        document["recordings"] = {name: told for name, told in document["recordings"].items() if name in parts}
    return sorted((judged(document, true) for _, document in submissions), key=lambda card: card["score"])


def submission(method: str, track: str, recordings: dict[str, Any]) -> dict[str, Any]:
    """A submission's document."""
    head = {"format": "edge-benchmark-submission", "version": 1, "method": method, "track": track}
    return head | {"recordings": recordings}


if __name__ == "__main__":
    sys.exit(main())
