"""Whether a chapter's HTML is complete in itself: the page opens from disk, without a network and without scripts."""

from __future__ import annotations

from html.parser import HTMLParser

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
