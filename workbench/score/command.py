"""`workbench score`: files in, files out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.errors import InputError, OutputError
from workbench.result_files import SubmissionFile, TruthFile
from workbench.score.judge import judged
from workbench.score.page import COLUMNS, card_html, picture
from workbench.storage import partial_path
from workbench.strict_json import strict_json

LARGEST = 2**27  # bytes of a file


def score(submission: Path, truth: Path, out: Path | None) -> str:
    """The card as text; with `out`, card.json, card.html and card.svg in that folder too.

    Raises:
        InputError: one of both is no such file, or they are of different tracks.
        OutputError: the card cannot be written.
    """
    truth = truth / TruthFile.NAME if truth.is_dir() else truth
    answer, true = SubmissionFile.read(submission, LARGEST), TruthFile.read(truth, LARGEST)
    if answer.track and true.track and answer.track != true.track:
        raise InputError(f"{submission}: $.track", f"expected '{true.track}' as in {truth}, found '{answer.track}'")
    if not set(answer.recordings) & set(true.recordings):
        example = next(iter(true.recordings), "none")
        raise InputError(f"{submission}: $.recordings", f"expected names as in {truth}, such as '{example}'")
    card = judged(answer.document, true.document)
    if out is not None:
        svg = picture([card])
        write(out, {"card.json": strict_json(card), "card.html": card_html(card, svg), "card.svg": svg})
    return text(card)


def text(card: Mapping[str, Any]) -> str:
    """For a terminal."""
    lines = [
        f"{card['method']}: score {card['score']:.4f} over {card['recordings']} recordings (0 best, 1 refuses all)"
    ]
    for name, one in card["quantities"].items():
        values = (
            f"{label} {scale * one[key]:.{digits}f}"
            for key, (label, scale, digits) in COLUMNS.items()
            if one[key] is not None
        )
        lines.append(f"  {name}: {', '.join(values)}")
    unknown = card["unknown_recordings"]
    return "\n".join([*lines, *([f"  not of this truth: {', '.join(unknown[:5])}"] if unknown else [])])


def write(folder: Path, files: Mapping[str, bytes]) -> None:
    """All of them or none."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        partial = {folder / name: partial_path(folder / name) for name in files}
        try:
            for part, content in zip(partial.values(), files.values(), strict=True):
                part.write_bytes(content)
            for path, part in partial.items():
                part.replace(path)
        finally:
            for part in partial.values():
                part.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(str(folder), f"cannot be written: {error.strerror}") from None
