"""The gallery: its page's commands are run, and the pictures that it asks for are taken out of the reports they make.

After a ```sh block the page says in a comment which pictures, by the beginning of their description in the report:

    <!-- pictures of out/gallery/plan/report.html: All layers of the path; Feed over arc length -->
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

from scripts.site.commands import PageError, follow

ASKED = re.compile(r"<!-- pictures of (\S+): (.*?) -->", re.DOTALL)
SUFFIX = {"image/png": ".png", "image/svg+xml": ".svg"}


def hang(page: Path, project: Path) -> int:
    """Run the commands of `page` in the folder `project` and put the pictures into the page; how many.

    Raises:
        PageError: a command fails, or its report has no such picture.
    """
    text = page.read_text()
    follow(text, project)
    pictures = [0]

    def shown(asked: re.Match[str]) -> str:
        found = pictures_of(project / asked[1])
        lines = []
        for name in " ".join(asked[2].split()).split("; "):
            words, kind, content = chosen(name, found, asked[1])
            pictures[0] += 1
            file = page.parent / f"made_{pictures[0]:02}{SUFFIX[kind]}"
            file.write_bytes(content)
            lines.append(f"```{{figure}} {file.name}\n:alt: {words}\n\n{words}\n```")
        return "\n\n".join(lines)

    page.write_text(ASKED.sub(shown, text))
    return pictures[0]


def chosen(name: str, found: list[tuple[str, str, bytes]], report: str) -> tuple[str, str, bytes]:
    """The first picture whose description begins with `name`."""
    for picture in found:
        if picture[0].startswith(name):
            return picture
    raise PageError(f"{report} has no picture '{name}', but {[words for words, _, _ in found]}")


def pictures_of(path: Path) -> list[tuple[str, str, bytes]]:
    """Description, kind and bytes of the pictures: those in a report, or the one that the file is."""
    if path.suffix == ".png":
        return [(path.stem.replace("_", " "), "image/png", path.read_bytes())]
    reader = _Pictures()
    reader.feed(path.read_text())
    return list(reader.found())


class _Pictures(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "img" and (given.get("src") or "").startswith("data:"):
            self.tags.append((given.get("alt") or "", given["src"] or ""))

    def found(self) -> Iterator[tuple[str, str, bytes]]:
        for words, address in self.tags:
            kind, _, content = address.removeprefix("data:").partition(";base64,")
            yield words, kind, base64.b64decode(content)
