"""Draw what the example of each stage makes: `python -m scripts.pictures [STAGE ...]`, into docs/stages/pictures.

The example in the stage's docstring is run. Of what its last call of the stage returned, or else took, the artefact
that says most is drawn (`kinds.py`); a chapter of a report shows the first of its own charts that is small enough. For
a stage that makes nothing to be drawn the head of the file that it writes is kept, as text.
"""

from __future__ import annotations

import base64
import contextlib
import doctest
import io
import re
import sys
from html import unescape

from scripts.pictures.kinds import DRAWN
from scripts.pictures.panels import drawn, titled
from scripts.stage_pages import DIRECTORY, PICTURES
from workbench.artefacts import Chapter, Document
from workbench.pipeline.catalogue import every_stage

MOST_BYTES = 60_000  # of a picture
HEAD_LINES, HEAD_WIDTH = 8, 96  # of a text
CHART = re.compile(r'<img[^>]*? src="data:image/svg\+xml;base64,([^"]+)" alt="([^"]*)"')
TAG, DIGITS = re.compile(r"<[^>]*>"), re.compile(r"(\.\d{3})\d+")  # of places, beyond a thousandth of a point
FOLDER = re.compile(r"[^\s\"']*/tmp\w+/")  # of an example's own files: another one each time


def main(names: list[str]) -> None:
    """Draw these stages, or all; remove what belongs to none."""
    stages = {name: one for name, one in every_stage()[0].items() if one.function.__module__.startswith("workbench.")}
    if unknown := set(names) - set(stages):
        raise SystemExit(f"no such stage: {', '.join(sorted(unknown))}")
    folder = DIRECTORY / PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or stages:
        suffix, content = picture(stages[name])
        for old in (".svg", ".txt"):
            (folder / f"{name}{old}").unlink(missing_ok=True)
        (folder / f"{name}{suffix}").write_bytes(content)
    for old in folder.iterdir():
        if old.name[:-4] not in stages:
            old.unlink()


def picture(stage) -> tuple[str, bytes]:
    """Suffix and content of a stage's picture, or of the text in its place."""
    made, took = ran(stage)
    for artefacts, others in ((made, took), (took, made)):
        for kind in (*DRAWN, "Chapter"):
            for one in (each for each in artefacts if type(each).__name__ == kind):
                if kind == "Chapter":
                    found = chart(one)
                else:
                    shown = DRAWN[kind](one, [each for each in (*others, *artefacts) if each is not one])
                    found = drawn(shown) if shown else None
                if found:
                    return ".svg", found
    for one in made:
        if isinstance(one, Document):
            return ".txt", text(one)
    raise SystemExit(
        f"{stage.name}: nothing that it makes or takes is drawn: add its type to scripts/pictures/kinds.py"
    )


def ran(stage) -> tuple[list[object], list[object]]:
    """What the last call of the stage in its example returned, and what it took; lists and tuples opened."""
    function = stage.function
    family = sys.modules[function.__module__.rpartition(".")[0]]
    plain, calls = getattr(family, function.__name__), []

    def kept(*args, **kwargs):
        made = plain(*args, **kwargs)
        calls.append((flat(made), flat((*args, *kwargs.values()))))
        return made

    names = {}
    setattr(family, function.__name__, kept)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            for one in doctest.DocTestParser().get_examples(stage.doc):
                exec(compile(one.source, stage.name, "single"), names)
    finally:
        setattr(family, function.__name__, plain)
    if not calls:
        raise SystemExit(f"{stage.name}: its example does not call it as {family.__name__}.{function.__name__}")
    return calls[-1]


def flat(value) -> list[object]:
    if isinstance(value, list | tuple):
        return [one for each in value for one in flat(each)]
    return [value]


def chart(chapter: Chapter) -> bytes | None:
    """The first of the chapter's charts that is small enough, on white, with its words as title."""
    for data, words in CHART.findall(chapter.html):
        svg = TAG.sub(lambda tag: DIGITS.sub(r"\1", tag[0]), base64.b64decode(data).decode())
        made = titled(svg, unescape(words))
        if len(made) < MOST_BYTES:
            return made
    return None


def text(document: Document) -> bytes:
    """The file's name, and its first lines."""
    lines = FOLDER.sub("", document.content.decode()).splitlines()
    head = [line if len(line) <= HEAD_WIDTH else f"{line[: HEAD_WIDTH - 4]} ..." for line in lines[:HEAD_LINES]]
    more = ["..."] if len(lines) > HEAD_LINES else []
    return "\n".join([document.name, *head, *more, ""]).encode()


if __name__ == "__main__":
    main(sys.argv[1:])
