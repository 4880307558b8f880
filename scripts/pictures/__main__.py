"""Draw what the example of each stage makes: `python -m scripts.pictures [STAGE ...]`, into docs/stages/pictures.

The example in the stage's docstring is run. Of what its last call of the stage returned the artefact that says most is
drawn (`kinds.py`); a chapter of a report shows the first of its own charts that is small enough. A stage that makes a
file, a recipe or a decision alone has no picture.
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
from scripts.pictures.panels import Picture, drawn, titled
from scripts.stage_pages import DIRECTORY, PICTURES
from workbench.artefacts import Chapter
from workbench.pipeline.catalogue import every_stage

MOST_BYTES = 60_000  # of a picture
CHART = re.compile(r'<img[^>]*? src="data:image/svg\+xml;base64,([^"]+)" alt="([^"]*)"')
TAG, DIGITS = re.compile(r"<[^>]*>"), re.compile(r"(\.\d{3})\d+")  # of places, beyond a thousandth of a point


def main(names: list[str]) -> None:
    """Draw these stages, or all; remove what belongs to none."""
    stages = {name: one for name, one in every_stage()[0].items() if one.function.__module__.startswith("workbench.")}
    if unknown := set(names) - set(stages):
        raise SystemExit(f"no such stage: {', '.join(sorted(unknown))}")
    folder = DIRECTORY / PICTURES
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or stages:
        (folder / f"{name}.svg").unlink(missing_ok=True)
        if content := picture(stages[name]):
            (folder / f"{name}.svg").write_bytes(content)
    for old in folder.iterdir():
        if old.stem not in stages:
            old.unlink()


def picture(stage) -> bytes | None:
    """A stage's picture, as SVG."""
    made, took = ran(stage)
    for kind, draw in DRAWN.items():
        for one in (each for each in made if type(each).__name__ == kind):
            beside = [each for each in (*took, *made) if each is not one]
            if (shown := draw(one, beside)) and (found := pictured(shown)):
                return found
    return None


def pictured(shown: Chapter | Picture | tuple[bytes, str]) -> bytes | None:
    """Charts as SVG; of a chapter the first that is small enough; a chart with its words."""
    if isinstance(shown, Picture):
        return drawn(shown)
    charts = [shown]
    if isinstance(shown, Chapter):
        charts = [(base64.b64decode(data), unescape(words)) for data, words in CHART.findall(shown.html)]
    made = (titled(TAG.sub(lambda tag: DIGITS.sub(r"\1", tag[0]), svg.decode()), words) for svg, words in charts)
    return next((one for one in made if len(one) < MOST_BYTES), None)


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


if __name__ == "__main__":
    main(sys.argv[1:])
