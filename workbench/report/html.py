"""The stage `report.html`: one page to sign under, complete in one file."""

from __future__ import annotations

from html.parser import HTMLParser

from workbench.artefacts import Chapter, Document, Provenance
from workbench.errors import InputError
from workbench.stage import stage

FORBIDDEN = {"script", "style", "link", "iframe", "object", "embed", "base", "meta", "form"}
ADDRESSES = {"src", "srcset", "href", "xlink:href", "data", "poster", "background", "action", "formaction", "ping"}
WITHIN = ("data:image/", "#")  # pictures that the page holds, places in it
CALLS = ("url", "image", "\\", "@")  # in a style: what could fetch something, or hide that it does


class _Outside(HTMLParser):
    """Collects what reaches outside."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in FORBIDDEN:
            self.found.append(f"<{tag}>")
        for name, value in attrs:
            address = (value or "").strip()
            elsewhere = name in ADDRESSES and not address.startswith(WITHIN)
            fetches = name == "style" and any(call in address.lower() for call in CALLS)
            if elsewhere or fetches or name.startswith("on") or name == "srcdoc":
                self.found.append(f"<{tag} {name}={address[:40]!r}>")


def outside(html: str) -> str:
    """'' where the HTML needs nothing else, else the first thing that does."""
    parser = _Outside()
    parser.feed(html)
    parser.close()
    return parser.found[0] if parser.found else ""


@stage("report.html")
def html(chapters: tuple[Chapter, ...], provenance: Provenance | None = None) -> Document:
    """The chapters as one self-contained page, `report.html`, with the overall verdict and the provenance.

    At the top the part, the overall verdict (the worst of the chapters that decide something) and a line a chapter;
    then the warnings, the chapters in the order of the pipeline, and what the run rests on. Chapters with a scene get
    a view that turns in the browser (WebGL 2), of 300,000 points on the page at most. The page needs no network to
    open; its only script is that viewer, which its content security policy names: a chapter that brings one is
    refused.

    Args:
        chapters: what stages such as `report.inspection` and `report.plan` made, plug-ins' included.
        provenance: inputs, versions, pipeline and seed; the runner supplies it, without it the page says so.

    Raises:
        InputError: no chapter, or one whose HTML reaches outside the page.

    Example:
        >>> from workbench import edge, inspect, report, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> groove = edge.segment_groove(points)
        >>> chapter = report.groove(points, groove, inspect.groove(groove))
        >>> page = report.html([chapter])
        >>> page.name, page.content[:15]
        ('report.html', b'<!doctype html>')
    """
    # jinja2 costs time to import: only where a page is made.
    from workbench.report.html import outside
    from workbench.report.page import page

    if not chapters:
        raise InputError("report", "expected at least one chapter, such as report.inspection makes")
    for chapter in chapters:
        if found := outside(chapter.html):
            raise InputError(f"chapter '{chapter.title}'", f"expected HTML that is complete in itself, got {found}")
    return Document("report.html", page(chapters, provenance).encode())
