"""Pieces of a report's chapter: HTML with every text escaped; colours of its pictures."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

INK, GREY, PALE = "#1b1f24", "#6b7280", "#c9ced6"
BLUE, ORANGE, GREEN, PURPLE, SKY, YELLOW = "#0072b2", "#d55e00", "#009e73", "#8c0f5b", "#56b4e9", "#b58900"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, YELLOW)  # told apart with any colour vision (after Okabe and Ito)

SPACE = '<figure class="space"><p class="note">The view in space needs WebGL 2 and scripts.</p></figure>'


def figure_html(picture: bytes, words: str, caption: str = "", colours: Iterable[tuple[str, str]] = ()) -> str:
    """A picture, SVG or PNG, with what it shows in words, a caption, and a key of (colour, name)."""
    kind = "png" if picture.startswith(b"\x89PNG") else "svg+xml"
    address = f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"
    key = _key(colours)
    below = f"<figcaption>{key}{escape(caption)}</figcaption>" if key or caption else ""
    tall = ' class="tall"' if _stacked(picture) else ""
    return f'<figure><img{tall} src="{address}" alt="{escape(words)}"/>{below}</figure>'


def _stacked(picture: bytes) -> bool:
    """Whether a chart in SVG is as high as several above each other: in print it gets the height to be read."""
    size = re.search(rb'viewBox="0 0 ([\d.]+) ([\d.]+)"', picture[:2000])
    return size is not None and float(size[2]) > 0.45 * float(size[1])


def _key(colours: Iterable[tuple[str, str]]) -> str:
    return "".join(
        f'<span class="key"><i style="background:{colour}"></i>{escape(name)}</span>' for colour, name in colours
    )


def panels_html(pictures: Iterable[tuple[bytes, str]], pairs: bool = False) -> str:
    """Small pictures beside each other, in print three or in pairs, each with its words as caption."""
    figures = "".join(figure_html(one, words, words) for one, words in pictures)
    return f'<div class="panels{" pairs" if pairs else ""}">{figures}</div>'


def minus(text: str) -> str:
    """A text with minus signs as such, and no sign before a number that rounds to nothing."""
    return re.sub(r"(?<![\w.])-(?=\d)", "−", re.sub(r"(?<![\w.])[+-](?=0(?:\.0+)?(?![\d.]))", "", text))


def number(value: float | None, form: str) -> str:
    """A value in a format of numbers; a dash where there is none."""
    return "–" if value is None or not np.isfinite(value) else format(value, form)


def _shown(value: str) -> str:
    return minus(escape(value))


def table_html(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", text: Iterable[int] = ()) -> str:
    """A table; the first cell of a row is its name, the columns `text` hold words, the others numbers."""
    words = {0, *text}

    def cell(i: int, value: str, tag: str) -> str:
        kind = ' class="text"' if i in words else ""
        return f"<{tag}{kind}>{_shown(value)}</{tag}>"

    names = "".join(cell(i, name, "th") for i, name in enumerate(head))
    body = "".join(
        "<tr>" + "".join(cell(i, value, "td" if i else "th") for i, value in enumerate(row)) + "</tr>" for row in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f'<table class="summary">{title}<thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>'


def columns_html(columns: Mapping[str, tuple[str, Any]], text: Iterable[int] = ()) -> str:
    """As `table_html`, by columns: of each head how its values are written (`str.format`), and these.

    A value of several numbers is written by as many fields.
    """
    cells = [[form.format(*np.atleast_1d(one)) for one in each] for form, each in columns.values()]
    return table_html(tuple(columns), zip(*cells, strict=True), text=text)


def facts_html(facts: Iterable[tuple[str, str]]) -> str:
    """Names and values, side by side."""
    rows = "".join(f"<div><dt>{escape(name)}</dt><dd>{_shown(value)}</dd></div>" for name, value in facts)
    return f'<dl class="facts">{rows}</dl>'


def list_html(items: Iterable[str]) -> str:
    """A list of sentences; '' where there are none."""
    rows = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{rows}</ul>" if rows else ""


def heading(words: str) -> str:
    """A section of the chapter; the page numbers it."""
    return f"<h3>{escape(words)}</h3>"


def note(words: str) -> str:
    """A remark in small print."""
    return f'<p class="note">{escape(words)}</p>'


def paragraph(words: str) -> str:
    """A sentence or two."""
    return f"<p>{escape(words)}</p>"
