"""Results as text: a line a part for who develops an engine, and one table."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.score.measure import Result
from bench.tables import markdown, shortened
from workbench.score.scorer import card, scale

HEAD = ("group", "simulator", "value", "parts", "refused", "score", "rms error", "median u", "within 2u, %")
HEAD += ("worst error/u", "beyond 4u, %", "U/T <= 0.2, %")
SHOWN = ("group", "value", "parts", "refused", "score", "median u", "within 2u, %", "beyond 4u, %", "U/T <= 0.2, %")
ODD_SHARE = 0.15  # of a shop's parts
Card = dict[str, float]
ALL = "all"
SEVERAL = re.compile(rf"^\| (.*?) \| {ALL} \| (.*?) \|", re.MULTILINE)  # of a table's row: group, value


def lines_of(result: Result) -> Iterator[str]:
    """What was found of one part: its cost, and its worst value."""
    name = f"{result.group} {result.simulator} {result.seed} ({result.about}) {result.seconds:.1f} s"
    if result.refused:
        yield f"{name}: {'CRASHED' if result.crashed else 'refused'}: {result.refused[:300]}"
        return
    told = []
    for quantity, found in result.found.items():
        text = f"{quantity} IS {found.cost(scale(quantity)[0]).mean():.3f}"
        if found.error.size:
            z = np.abs(found.error) / found.u
            k = int(z.argmax())
            text += f", worst {found.error[k]:+.4f} = {z[k]:.1f} u, u {np.median(found.u):.4f}"
        lost = np.setdiff1d(found.wanted, found.piece).size
        told.append(text + f", {lost} missing" * bool(lost))
    passed = f"; {result.passed_wrongly} PASS beyond 4u" * bool(result.passed_wrongly)
    yield f"{name}: {'; '.join(told)}{passed}"


def table(results: Sequence[Result]) -> str:
    """Every quantity of every group by simulator, and of the shop that has 15 % odd parts."""
    rows = []
    cards: dict[tuple[str, str], Card] = {}
    for group in dict.fromkeys(r.group for r in results):
        mine = [r for r in results if r.group == group]
        by = {name: [r for r in mine if r.simulator == name] for name in dict.fromkeys(r.simulator for r in mine)}
        for quantity in dict.fromkeys(name for r in mine for name in r.found):
            for simulator, some in {**by, ALL: mine}.items():
                found = [r.found[quantity] for r in some if quantity in r.found]
                one = cards[group, quantity] = card(found, quantity)
                if simulator != ALL or len(by) > 1:
                    rows.append(row(group, simulator, quantity, one))
    return "\n".join([*markdown(HEAD, rows), "", *shop(cards), *verdicts(results)])


def row(group: str, simulator: str, quantity: str, c: Card) -> list[str]:
    digits = 4 if quantity.endswith("mm") else 3
    numbers = [f"{c['score']:.3f}", f"{c['rms_error']:.{digits}f}", f"{c['sharpness'] / 2:.{digits}f}"]
    numbers += [f"{100 * c['coverage']:.1f}", f"{c['worst_error_over_u']:.1f}"]
    numbers += [f"{100 * c['beyond_4u']:.2f}", f"{100 * c['useful']:.0f}"]
    return [group, simulator, f"`{quantity}`", str(c["recordings"]), str(c["refused"]), *numbers]


def shop(cards: dict[tuple[str, str], Card]) -> list[str]:
    """The score where 15 % of the parts are odd."""
    lines = []
    for ordinary in ("sharp", "undeclared", "worn"):
        for quantity in ("root_mm", "bevel_deg"):
            if (ordinary, quantity) in cards and ("odd", quantity) in cards:
                plain, odd = cards[ordinary, quantity], cards["odd", quantity]
                score, beyond = ((1 - ODD_SHARE) * plain[k] + ODD_SHARE * odd[k] for k in ("score", "beyond_4u"))
                lines.append(f"- 85 % {ordinary}, 15 % odd: `{quantity}` {score:.3f}, {100 * beyond:.2f} % beyond 4u")
    return lines


def verdicts(results: Sequence[Result]) -> list[str]:
    passed, crashed = sum(r.passed_wrongly for r in results), sum(bool(r.crashed) for r in results)
    whole = sum(r.passed_wrongly for r in results if r.passed)
    seconds = sum(r.seconds for r in results)
    return [
        f"- verdict `pass` on a section beyond 4u: {passed}, of parts that pass: {whole}; crashed: {crashed}; "
        f"{seconds:.0f} s of processor time for {len(results)} parts"
    ]


def summary(page: Path, text: str) -> str:
    """Of every value the row of all simulators together where there are several."""
    several = {(group, value) for group, value in SEVERAL.findall(text)}
    return shortened(page, text, "Simulators", SHOWN, lambda row: row[1] == ALL or (row[0], row[2]) not in several)
