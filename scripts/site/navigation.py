"""The site's navigation, out of the pages as they are: headings and lists of docs/README.md, tables of links.

On a git host those are links like any; here they are also the table of contents.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

INDEX, START, STAGES = "docs/README.md", "README.md", "docs/stages/README.md"
HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
LINK = re.compile(r"\[([^]]+)\]\(([^)#\s]+\.md)(?:#[^)\s]*)?\)")
REST = "More"


def add(source: Path) -> None:
    """Hidden tables of contents at the end of the start page and of the stages' index; every page is in one."""
    pages = {str(path.relative_to(source)) for path in source.rglob("*.md")} - {START, INDEX}
    stages = sorted(page for page in pages if page.startswith("docs/stages/") and page != STAGES)
    chapters = dict(chapters_of((source / INDEX).read_text(), INDEX))
    listed = {page for chapter in chapters.values() for page in chapter}
    rest = {page: "" for page in [INDEX, *sorted(pages - {*stages} - listed)]}
    _append(source / START, [toctree(name, chapter) for name, chapter in [*chapters.items(), (REST, rest)]])
    _append(source / STAGES, [toctree("", {f"/{page}": "" for page in stages})])


def chapters_of(text: str, name: str) -> Iterator[tuple[str, dict[str, str]]]:
    """Heading of each part of a page that has links, and its linked pages (paths from the top), with their words."""
    _, *parts = HEADING.split(text)
    for heading, body in zip(parts[::2], parts[1::2], strict=True):
        pages = {_from_the_top(target, name): words[0].upper() + words[1:] for words, target in LINK.findall(body)}
        pages.pop(START, None)  # the root of the contents itself
        if pages:
            yield heading, pages


def toctree(caption: str, pages: Mapping[str, str]) -> str:
    """In MyST's notation; a page without words of its own stands under its title."""
    head = ["```{toctree}", ":hidden:", *([f":caption: {caption}"] if caption else [])]
    names = (page.removesuffix(".md") for page in pages)
    entries = [f"{words} <{name}>" if words else name for name, words in zip(names, pages.values(), strict=True)]
    return "\n".join([*head, "", *entries, "```"])


def _from_the_top(target: str, page: str) -> str:
    return os.path.normpath(os.path.join(os.path.dirname(page), target))


def _append(page: Path, parts: list[str]) -> None:
    page.write_text("\n\n".join([page.read_text(), *parts]) + "\n")
