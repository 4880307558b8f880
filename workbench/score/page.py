"""A score card as a page, and the picture: coverage against sharpness, a point a quantity and method."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from workbench.marks import TOLERANCE, Lettering
from workbench.pieces import BLUE, GREEN, GREY, INK, ORANGE, SKY, table_html
from workbench.plot import Figure
from workbench.report.html_stage import policy
from workbench.report.text import source
from workbench.score.judge import points

HONEST = (93.0, 97.0)  # % within U = 2 u: what k = 2 says, give or take 2
DECADES = (0.001, 0.01, 0.1, 1.0, 10.0)  # of U over the tolerance
INKS = (BLUE, ORANGE, GREEN, "#cc79a7", "#e69f00", SKY, INK)
COLUMNS = {
    "score": ("score", 1.0, 4),
    "values": ("values", 1.0, 0),
    "refused": ("refused", 1.0, 0),
    "coverage": ("within U, %", 100.0, 1),
    "beyond_4u": ("beyond 4u, %", 100.0, 2),
    "worst_error_over_u": ("worst error/u", 1.0, 1),
    "sharpness": ("median U", 1.0, 4),
    "rms_error": ("rms error", 1.0, 4),
    "useful": ("U/T <= 0.2, %", 100.0, 0),
}


def picture(cards: Sequence[Mapping[str, Any]]) -> bytes:
    """SVG: up, the share of values within U (95 % is honest); to the left, the sharper. A colour a method."""
    found = points(cards)
    methods = list(dict.fromkeys(method for method, *_ in found))
    figure = Figure(figsize=(8.4, 4.2))
    axes = figure.add_axes((0.1, 0.14, 0.52, 0.8))
    axes.axhspan(*HONEST, color=TOLERANCE)
    axes.set(
        xlim=(-3.3, 1.3),
        ylim=(-4.0, 104.0),
        xticks=([float(np.log10(d)) for d in DECADES], [f"{d:g}" for d in DECADES]),
        xlabel="median U over the tolerance (half its width)",
        ylabel="values within U = 2u, %",
    )
    for number, method in enumerate(methods):
        ink = INKS[number % len(INKS)]
        mine = np.array([(np.log10(sharp), 100.0 * share) for name, _, share, sharp in found if name == method])
        axes.points(mine[:, 0], mine[:, 1], "o", color=ink, markersize=5.0)
        axes.annotate("●", (1.04, 0.94 - 0.07 * number), (0.0, 0.0), xycoords="axes fraction", look=Lettering(ink))
        axes.annotate(method[:40], (1.08, 0.94 - 0.07 * number), (0.0, 0.0), xycoords="axes fraction")
    for _, quantity, share, sharp in found if len(methods) == 1 else ():
        axes.annotate(quantity, (np.log10(sharp), 100.0 * share), (5.0, 0.0), xycoords="data", look=Lettering(GREY))
    return figure.svg()


def card_html(card: Mapping[str, Any], svg: bytes) -> bytes:
    """One page that needs nothing else: the table, the picture, and what the columns mean."""
    labels = [card["track"], card["set"], f"benchmark {card['benchmark']}" if card["benchmark"] else None]
    where = html.escape(", ".join(str(word) for word in labels if word))
    rows = [
        [
            name,
            *(
                "" if one[key] is None else f"{scale * one[key]:.{digits}f}"
                for key, (_, scale, digits) in COLUMNS.items()
            ),
        ]
        for name, one in card["quantities"].items()
    ]
    table = table_html(["value", *(text for text, _, _ in COLUMNS.values())], rows)
    score = "" if card["score"] is None else f"{card['score']:.4f}"
    unknown = f"<p>{len(card['unknown_recordings'])} recordings are not of this truth.</p>"
    seconds = "" if card["seconds_median"] is None else f"; median {card['seconds_median']:.2f} s a recording"
    name, style = html.escape(card["method"]), source("page.css")
    security = f'<meta http-equiv="Content-Security-Policy" content="{policy("")}">'
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{name}: score</title>{security}'
        f"<style>{style}</style></head><body><main><h1>{name}: {score}</h1>"
        f"<p>{where}; {card['recordings']} recordings{seconds}. The score is the mean over the quantities of the "
        "interval score over the price of a refusal: 0 is perfect, 1 is what refusing everything costs.</p>"
        f"{table}{unknown if card['unknown_recordings'] else ''}{svg.decode()}"
        "<p>Interval score of a value with error e and standard uncertainty u: 2 k u + 40 max(0, |e| - k u), k = 1.96; "
        "missing: 1 mm or 2 deg. Honest: 95 % within U = 2u. Sharp: a small U.</p></main></body></html>\n"
    ).encode()
