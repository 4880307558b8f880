"""The docs pages of the stages, from their signatures: `python -m workbench.pipeline.docs [DIRECTORY]`."""

from __future__ import annotations

import html
import json
import re
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path

from workbench.pipeline.describe import ParameterText, makes, parameter_texts, prose, source_text, summary
from workbench.pipeline.registry import BUILT_IN, every_stage
from workbench.stage import Stage

DIRECTORY, PICTURES = Path("docs/stages"), "pictures"
NOTE = "<!-- Written by `python -m workbench.pipeline.docs` from the stage's signature: change it there. -->"
EXAMPLE = re.compile(r"^Example:\n((?: +.*\n?|\n)+)", re.MULTILINE)
TITLE = re.compile(r"<title>(.*?)</title>", re.DOTALL)


def pages(directory: Path = DIRECTORY) -> dict[str, str]:
    """File name -> Markdown: one page for every stage of the project, with the picture in `directory`; their index."""
    found, broken = every_stage()
    for family in BUILT_IN:
        if family in broken:
            raise SystemExit(broken[family])
    own = {name: stage for name, stage in found.items() if stage.function.__module__.startswith("workbench.")}
    return {"README.md": index(own), **{f"{name}.md": page(stage, directory) for name, stage in own.items()}}


def index(stages: Mapping[str, Stage]) -> str:
    """The table of all stages."""
    rows = [f"| [`{name}`]({name}.md) | {makes(stage)} | {_cell(summary(stage))} |" for name, stage in stages.items()]
    return "\n".join([NOTE, "# Stages", "", "| stage | makes | what it does |", "|---|---|---|", *rows, ""])


def page(stage: Stage, directory: Path = DIRECTORY) -> str:
    """One stage: what it does, takes and makes, its parameters, its example and what that makes."""
    takes = [f"- `{source.name}`: {source_text(source)}" for source in stage.sources]
    parts = [
        NOTE,
        f"# `{stage.name}`",
        _markdown(EXAMPLE.sub("", prose(stage)).strip()),
        "## Takes",
        "\n".join(takes) or "No artefact.",
        "## Makes",
        makes(stage),
    ]
    parameters = parameter_texts(stage)
    table = [
        "| parameter | type | unit | default | range | meaning |",
        "|---|---|---|---|---|---|",
        *map(_row, parameters),
    ]
    parts += ["## Parameters", "\n".join(table) if parameters else "None."]
    example = {"stage": stage.name} | {one.name: f"${{{one.name}}}" for one in parameters if one.default == "required"}
    parts += ["## In a pipeline", f"```json\n{json.dumps(example)}\n```"]
    if shown := EXAMPLE.search(stage.doc):
        parts += ["## In Python", f"```python\n{textwrap.dedent(shown[1]).strip()}\n```"]
        parts += picture(stage.name, directory)
    return "\n\n".join(parts) + "\n"


def picture(name: str, directory: Path) -> list[str]:
    """What the example makes, as `python -m scripts.pictures` drew it; or the head of the text that it writes."""
    drawn, written = (directory / PICTURES / f"{name}{suffix}" for suffix in (".svg", ".txt"))
    if drawn.exists() and (title := TITLE.search(drawn.read_text(encoding="utf-8"))):
        words = html.unescape(title[1])
        return [f"![{words}]({PICTURES}/{drawn.name})", f"*{words}.*"]
    if written.exists():
        file, _, head = written.read_text(encoding="utf-8").partition("\n")
        return [f"No picture: the example writes `{file}`, which begins:", f"```text\n{head.rstrip()}\n```"]
    return []


def _markdown(text: str) -> str:
    """A docstring's list of errors under a heading of its own."""
    head, mark, errors = text.partition("\nRaises:\n")
    return f"{head}\n## Refuses\n\n{textwrap.dedent(errors)}" if mark else head


def _row(one: ParameterText) -> str:
    default = one.default if one.default == "required" else f"`{one.default}`"
    cells = (f"`{one.name}`", one.type, one.unit, default, one.range, one.description)
    return "| " + " | ".join(map(_cell, cells)) + " |"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def main(directory: Path) -> None:
    """Write the pages, and remove those of stages that are gone."""
    written = pages(directory)
    directory.mkdir(parents=True, exist_ok=True)
    for old in directory.glob("*.md"):
        if old.name not in written:
            old.unlink()
    for name, text in written.items():
        (directory / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DIRECTORY)
