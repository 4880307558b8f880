"""The site's navigation, out of the pages as they are: headings and lists of docs/README.md, tables of links.

On a git host those are links like any; here they are also the table of contents.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

INDEX, START, STAGES = "docs/README.md", "README.md", "docs/stages/README.md"
HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#\s]+\.md)(?:#[^)\s]*)?\)")
REST = "More"


def add(source: Path) -> None:
    """Hidden tables of contents at the end of the start page and of the stages' index; every page is in one."""
    pages = {str(path.relative_to(source)) for path in source.rglob("*.md")} - {START, INDEX}
    stages = {page for page in pages if page.startswith("docs/stages/")} - {STAGES}
    chapters = dict(chapters_of((source / INDEX).read_text(), INDEX))
    listed = {page for chapter in chapters.values() for page in chapter}
    rest = sorted(pages - stages - listed)
    contents = [toctree(name, [page for page in chapter if page != START]) for name, chapter in chapters.items()]
    contents += [toctree(REST, [INDEX, *rest])]
    _append(source / START, contents)
    _append(source / STAGES, [toctree("", [os.path.relpath(page, "docs/stages") for page in sorted(stages)])])


def chapters_of(text: str, name: str) -> Iterator[tuple[str, list[str]]]:
    """Heading and linked pages (paths from the top) of each part of a page that has links."""
    _, *parts = HEADING.split(text)
    for heading, body in zip(parts[::2], parts[1::2], strict=True):
        pages = [os.path.normpath(os.path.join(os.path.dirname(name), target)) for target in LINK.findall(body)]
        if pages:
            yield heading, list(dict.fromkeys(pages))


def toctree(caption: str, pages: list[str]) -> str:
    """In MyST's notation."""
    head = ["```{toctree}", ":hidden:", *([f":caption: {caption}"] if caption else [])]
    return "\n".join([*head, "", *(page.removesuffix(".md") for page in pages), "```"])


def _append(page: Path, parts: list[str]) -> None:
    page.write_text("\n\n".join([page.read_text(), *parts]) + "\n")
