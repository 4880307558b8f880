"""A submission against a truth file, as one card."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from workbench.score import scorer


def judged(submission: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
    """The card: every quantity's score, coverage, sharpness and worst case, and one number for the track.

    submission, truth: documents of these files (`workbench schema submission`, `truth`). What the truth has and the
    submission has not counts as refused. `score`: mean over the quantities of score over price, so 1 is what it costs
    to refuse everything.

    >>> stations = {"position_mm": [[0, 0, 0], [9, 0, 0]], "seen": [True, True], "root_mm": [1.5, 1.5]}
    >>> row = {"origin_mm": [4.5, 0, 0], "root_mm": 1.51, "root_u_mm": 0.01}
    >>> card = judged({"method": "mine", "recordings": {"a": {"sections": [row]}}}, {"recordings": {"a": stations}})
    >>> card["quantities"]["root_mm"]["worst_error_over_u"]
    1.0
    """
    recordings, given = truth["recordings"], submission["recordings"]
    each = {name: scorer.compare(true, given.get(name) or {}) for name, true in recordings.items()}
    quantities = {
        name: scorer.card([found[name] for found in each.values() if name in found], name)
        for name in dict.fromkeys(name for found in each.values() for name in found)
    }
    seconds = [reply["seconds"] for reply in map(given.get, recordings) if reply and reply.get("seconds") is not None]
    shares = [card["score"] / scorer.scale(name)[0] for name, card in quantities.items()]
    return {
        "format": "score-card",
        "version": 1,
        "method": submission["method"],
        "track": truth.get("track"),
        "benchmark": truth.get("benchmark"),
        "set": truth.get("set"),
        "recordings": len(recordings),
        "unknown_recordings": sorted(set(given) - set(recordings)),
        "score": sum(shares) / len(shares) if shares else None,
        "seconds_median": sorted(seconds)[len(seconds) // 2] if seconds else None,
        "seconds_worst": max(seconds, default=None),
        "quantities": {
            name: {key: None if math.isnan(value) else value for key, value in card.items()}
            for name, card in quantities.items()
        },
    }


def points(cards: Iterable[Mapping[str, Any]]) -> list[tuple[str, str, float, float]]:
    """Method, quantity, coverage in 1 and sharpness (median U over half the tolerance's width): what is drawn."""
    return [
        (card["method"], name, one["coverage"], one["sharpness"] / scorer.scale(name)[1])
        for card in cards
        for name, one in card["quantities"].items()
        if one["coverage"] is not None
    ]
