"""Tables of a gauge study: measurements by part, operator, trial and section; what they are compared with."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from workbench.compare.measurements import Measurement
from workbench.compare.values import CHARACTERISTICS
from workbench.errors import InputError
from workbench.units import Float

LEAST_VALUES = 4  # that are equal one by one: fewer may be by chance, rounded as gauges show them
APART_MM = 1.0  # sections of one number that lie farther apart measure different places
Limits = tuple[float, float]


def balanced(mine: Sequence[Measurement], where: str) -> Mapping[tuple[str, str], list[Measurement]]:
    """The measurements of each part by each operator: equally many in every cell, two or more."""
    cells: dict[tuple[str, str], list[Measurement]] = {}
    for one in mine:
        cells.setdefault((one.part, one.operator), []).append(one)
    parts, operators = {p for p, _ in cells}, {o for _, o in cells}
    counts = {(p, o): len(cells.get((p, o), ())) for p in sorted(parts) for o in sorted(operators)}
    most = max(counts.values(), default=0)
    for (part, operator), count in counts.items():
        if count < most:
            raise InputError(
                where,
                f"part '{part}', operator '{operator}': expected {most} trials as elsewhere, found "
                f"{count}; a study is crossed and balanced",
            )
    if most < 2:
        raise InputError(where, f"expected two trials or more of each part by each operator, found {most}")
    return cells


def sections_of(mine: Sequence[Measurement]) -> tuple[int, ...]:
    """The sections' numbers, the same in every measurement."""
    sections = tuple(sorted(mine[0].sections))
    for one in mine:
        if tuple(sorted(one.sections)) != sections:
            raise InputError(
                one.where,
                f"expected sections {sections[0]} to {sections[-1]} as in {mine[0].where}, "
                f"found {len(one.sections)} sections",
            )
    return sections


def table_of(
    cells: Mapping[tuple[str, str], list[Measurement]],
    parts: list[str],
    operators: list[str],
    sections: tuple[int, ...],
    name: str,
) -> Float:
    """(P, O, R, S)."""
    return np.array(
        [
            [[[one.sections[s].get(name, np.nan) for s in sections] for one in cells[p, o]] for o in operators]
            for p in parts
        ]
    )


def refuse_copies(measured: Mapping[str, Float], parts: list[str], operators: list[str], where: str) -> None:
    """Refuse trials that repeat others figure by figure, each characteristic (P, O, R, S): copies are no evidence.

    Looked for over all parts, and part by part where one trial has enough values.
    """
    table = np.concatenate(list(measured.values()), axis=3)
    runs = [(o, r) for o in range(table.shape[1]) for r in range(table.shape[2])]
    for rows, name in [(slice(None), ""), *((slice(k, k + 1), f"part '{part}', ") for k, part in enumerate(parts))]:
        for (a, first), (b, second) in itertools.combinations(runs, 2):
            one, other = table[rows, a, first], table[rows, b, second]
            seen = int(np.isfinite(one).sum())
            if seen >= LEAST_VALUES and np.array_equal(one, other, equal_nan=True):
                raise InputError(
                    where,
                    f"{name}operator '{operators[b]}', trial {second + 1} repeats operator '{operators[a]}', trial "
                    f"{first + 1} figure by figure in all {seen} values: copied, or rounded too coarsely to differ?",
                )


def reference_of(
    others: Sequence[Measurement], parts: list[str], sections: tuple[int, ...], names: list[str]
) -> dict[str, tuple[Float, Float]]:
    """Mean and standard uncertainty (P, S) of the reference measurements, which may share all of their errors."""
    found = {}
    for name in names:
        value, u = np.full((2, len(parts), len(sections)), np.nan)
        for i, part in enumerate(parts):
            mine = [one for one in others if one.part == part]
            for k, s in enumerate(sections):
                seen = [one.sections[s] for one in mine if s in one.sections and np.isfinite(one.sections[s][name])]
                if seen:
                    value[i, k] = np.mean([row[name] for row in seen])
                    u[i, k] = np.mean([row.get(CHARACTERISTICS.get(name, ""), np.nan) for row in seen])
        found[name] = value, u
    return found


def limits_of(given: Limits | None, mine: Sequence[Measurement], name: str, where: str) -> Limits | None:
    """The limits given, or those that all inspections state; None: they state none."""
    stated = {one.limits[name] for one in mine if name in one.limits}
    if given is None and not stated:
        return None
    if given is None and len(stated) > 1:
        raise InputError(where, f"the inspections state different limits of {name}: name those that hold")
    low, high = given or next(iter(stated))
    if not low < high:
        raise InputError(where, f"expected a lower limit of {name} below the upper one, found {low:g} and {high:g}")
    return low, high


def mean_of_seen(values: Float, axis: tuple[int, ...]) -> Float:
    """Mean of what is there; NaN where nothing is."""
    count = np.isfinite(values).sum(axis=axis)
    return np.asarray(np.where(count > 0, np.nansum(values, axis=axis) / np.maximum(count, 1), np.nan))


def apart(arc_length_mm: Float) -> tuple[str, ...]:
    """Whether sections of one number lie at one place of a part, as far as arc lengths tell."""
    off = np.abs(arc_length_mm - mean_of_seen(arc_length_mm, (1, 2))[:, None, None])
    worst = float(np.nan_to_num(off).max())
    if worst <= APART_MM:
        return ()
    return (
        f"sections of one number lie up to {worst:.1f} mm off their mean arc length: the scans cover different "
        "stretches, and what the part changes along the edge counts as the gauge's",
    )
