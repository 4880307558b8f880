"""Pieces of a chapter's HTML, and the style of its pictures. Text is escaped here."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

INK, GREY, PALE = "#1b1f24", "#6b7280", "#c9ced6"
BLUE, ORANGE, GREEN, PURPLE, SKY, YELLOW = "#0072b2", "#d55e00", "#009e73", "#8c0f5b", "#56b4e9", "#b58900"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, YELLOW)
STYLE: Any = {
    "font.size": 9.0,
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "svg.fonttype": "path",
    "svg.hashsalt": "workbench",
    "axes.titlesize": 9.0,
    "axes.titlelocation": "left",
    "legend.frameon": False,
}


def styled() -> Any:
    """Context in which pictures are made and written."""
    return rc_context(STYLE)


def svg(figure: Figure) -> bytes:
    """The figure's bytes, the same for the same data."""
    out = io.BytesIO()
    figure.savefig(out, format="svg", dpi=200, metadata={"Date": None, "Creator": None})
    return out.getvalue()


def figure_html(picture: bytes, words: str, caption: str) -> str:
    """A picture with what it shows in words, and a caption."""
    address = f"data:image/svg+xml;base64,{base64.b64encode(picture).decode()}"
    return f'<figure><img src="{address}" alt="{escape(words)}"/><figcaption>{escape(caption)}</figcaption></figure>'


def table_html(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> str:
    """A table; the first cell of a row is its name."""
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(
        "<tr>"
        + "".join(f"<{'td' if i else 'th'}>{escape(cell)}</{'td' if i else 'th'}>" for i, cell in enumerate(row))
        + "</tr>"
        for row in rows
    )
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f'<table class="summary">{title}<thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>'


def facts_html(facts: Iterable[tuple[str, str]]) -> str:
    """Names and values, side by side."""
    rows = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    return f'<dl class="facts">{rows}</dl>'


def heading(words: str) -> str:
    """A section of the chapter; the page numbers it."""
    return f"<h3>{escape(words)}</h3>"


def note(words: str) -> str:
    """A remark in small print."""
    return f'<p class="note">{escape(words)}</p>'


def paragraph(words: str) -> str:
    """A sentence or two."""
    return f"<p>{escape(words)}</p>"
