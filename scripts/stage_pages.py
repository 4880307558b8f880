"""The docs pages of the stages, from their signatures: `python -m scripts.stage_pages [DIRECTORY]`."""

from __future__ import annotations

import doctest
import html
import itertools
import re
import sys
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path

from workbench.pipeline.catalogue import (
    BUILT_IN,
    ParameterText,
    every_stage,
    makes,
    parameter_texts,
    prose,
    source_text,
)
from workbench.stage import Stage

DIRECTORY, PICTURES = Path("docs/stages"), "pictures"
NOTE = "<!-- This page and those of the stages are written by scripts.stage_pages -->"
READING = """A parameter has a default (none: required), type, range and meaning; the end of its name is its unit;
`null` means "not given"; a path starts at the pipeline's folder ([pipelines](../pipelines.md)), in Python at the
working directory. Input that cannot be used is refused (exit status 2, in Python `InputError`); `workbench stages NAME`
tells what is refused."""
IMPLIED = {"number", "integer", "text", "true or false", "[number, number]", "[number, number, number]", "object"}
EXAMPLE = re.compile(r"^Example:\n((?: +.*\n?|\n)+)", re.MULTILINE)
RAISES = re.compile(r"^Raises:\n((?: +.*\n?)+)", re.MULTILINE)
REPEATED = re.compile(r'\[("[^\]]*?)((?:, \1)+)\]')
NUMBERS = re.compile(r"\[number(?:, number)+\]")
EMPTY = re.compile(r"\{(\"\w+\": null(, )?)+\}")  # an object of which nothing is given
PARSER = doctest.DocTestParser()
LONG = 7  # words of a description
AS_IN = re.compile(r"as in `([\w.]+)`\.?")  # that tells nothing else
PAGE = re.compile(r"docs/((?:\w+/)*(\w+)\.md)")
TITLE = re.compile(r"<title>(.*?)</title>", re.DOTALL)


def pages(directory: Path = DIRECTORY) -> dict[str, str]:
    """File name -> Markdown: one page for every stage of the project, with the picture in `directory`; their index."""
    found, broken = every_stage()
    for family in BUILT_IN:
        if family in broken:
            raise SystemExit(broken[family])
    own = {name: stage for name, stage in found.items() if stage.function.__module__.startswith("workbench.")}
    told = {_item(one): name for name, stage in reversed(own.items()) for one in parameter_texts(stage)}
    return {"README.md": index(own), **{f"{name}.md": page(stage, told, directory) for name, stage in own.items()}}


def index(names: Iterable[str]) -> str:
    """The list of all stages, a line a family, and how their pages are read."""
    families = itertools.groupby(names, lambda name: name.partition(".")[0])
    rows = ["- " + ", ".join(f"[`{name}`]({name}.md)" for name in some) for _, some in families]
    return "\n".join([NOTE, "# Stages", "", READING, "", *rows, ""])


def page(stage: Stage, told: Mapping[str, str], directory: Path) -> str:
    """One stage: what it does, takes and makes, its parameters (`told`: which stage tells of one first), example."""
    sources = ", ".join(f"`{source.name}`: {source_text(source)}" for source in stage.sources)
    takes = f"**Takes** {sources}. " if sources else ""
    parts = [
        f"# `{stage.name}`",
        f"{takes}**Makes** {makes(stage)}.",
        _linked(RAISES.sub("", EXAMPLE.sub("", prose(stage))).strip()),
    ]
    if parameters := parameter_texts(stage):
        parts += ["## Parameters", "\n".join(_items(parameters, stage.name, told))]
    if shown := EXAMPLE.search(stage.doc):
        parts += ["## Example", f"```python\n{script(textwrap.dedent(shown[1]))}\n```"]
        parts += picture(stage.name, directory)
    return "\n\n".join(parts) + "\n"


def script(example: str) -> str:
    """An example without its prompts, to be copied; what it shows as comments."""
    lines = [line for one in PARSER.get_examples(example) for line in (one.source.rstrip(), _comment(one.want))]
    return "\n".join(line for line in lines if line)


def _comment(shown: str) -> str:
    return "\n".join(f"# {line}" for line in shown.splitlines())


def picture(name: str, directory: Path) -> list[str]:
    """What the example makes, as `python -m scripts.pictures` drew it."""
    drawn = directory / PICTURES / f"{name}.svg"
    if not drawn.exists():
        return []
    title = TITLE.findall(drawn.read_text(encoding="utf-8"))[0]
    return [f"![]({PICTURES}/{drawn.name})\n\n*{html.unescape(title)}.*"]


def _items(parameters: Iterable[ParameterText], here: str, told: Mapping[str, str]) -> list[str]:
    """A line each, and one for those that another stage's page tells in many words."""
    lines, before = dict[str, list[str]](), here
    for one in parameters:
        text = _item(one)
        said = AS_IN.fullmatch(one.description)
        first = said[1] if said else told[text]
        # `likewise` stays with what it refers to
        before = first if said or first == before or len(one.description.split()) >= LONG else here
        lines.setdefault(before, []).append(text if before == here else f"`{_named(one)}`")
    own = lines.pop(here, [])
    return own + [f"- As in [`{first}`]({first}.md): {', '.join(some)}." for first, some in lines.items()]


def _item(one: ParameterText) -> str:
    """One parameter on a line, as Python has it; what a default shows by itself (a number) is not said again."""
    required = one.default == "required"
    of_type = one.type.removesuffix(" or null") if one.default == "null" else one.type
    implied = of_type in IMPLIED and (one.range or (of_type == one.type and not required))
    kind = "" if implied else f" ({_short(of_type)})"
    bounds = f", {_interval(one.range)}" if one.range else ""
    return f"- `{_named(one)}`{kind}{bounds}: {_line(one.description)}"


def _named(one: ParameterText) -> str:
    return one.name if one.default == "required" else f"{one.name}={EMPTY.sub('{}', one.default)}"


def _short(of_type: str) -> str:
    """A choice as a list, many of one kind by their count."""
    counted = REPEATED.sub(lambda found: f"{found[0].count(found[1])} of {found[1]}", of_type)
    listed = counted.replace('" or "', '", "')
    return NUMBERS.sub(lambda found: f"{found[0].count('number')} numbers", listed)


def _interval(bounds: str) -> str:
    """'0 < value <= 5' as '(0, 5]'; with one bound only, as '>0'."""
    low, _, high = (side.split() for side in bounds.partition("value"))
    if low and high:
        return f"{'[('[low[1] == '<']}{low[0]}, {high[1]}{'])'[high[0] == '<']}"
    return {"<": ">", "<=": "≥"}[low[1]] + low[0] if low else "".join(high).replace("<=", "≤")


def _line(text: str) -> str:
    return _linked(" ".join(text.split()))


def _linked(text: str) -> str:
    return PAGE.sub(r"[\2](../\1)", text)


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
