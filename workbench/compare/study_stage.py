"""`compare.study`: a gauge study out of many inspections, as tables by part, operator, trial and section."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts.evidence import shared
from workbench.compare.measurements import (
    CHARACTERISTICS,
    Measurement,
    Study,
    measurements_of,
    read_inspection,
)
from workbench.errors import InputError
from workbench.parameters import MISTAKEN
from workbench.stage import InputFile, stage
from workbench.units import Float

LEAST_VALUES = 4  # that are equal one by one: fewer may be by chance, rounded as gauges show them
ALIKE = 0.2  # of a size, within which another one is the same in another unit
USUAL, SLIP = 0.9, 12.0  # quantile of how far values lie from their part's median; times that: no gauge errs so
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


def refuse_slips(measured: Mapping[str, Float], parts: list[str], operators: list[str], where: str) -> None:
    """Refuse a single value of another size than its part, each characteristic (P, O, R, S): a slip of unit or sign."""
    for name, values in measured.items():
        seen = np.isfinite(values)
        usual = np.array([np.median(one[at]) if at.any() else 0.0 for one, at in zip(values, seen, strict=True)])
        off = np.where(seen, np.abs(values - usual[:, None, None, None]), 0.0)
        apart_by = np.quantile(off, USUAL)
        p, o, r, s = np.unravel_index(int(off.argmax()), off.shape)
        if apart_by > 0.0 and off[p, o, r, s] > max(SLIP * apart_by, abs(usual[p]) / 2.0):
            raise InputError(
                where,
                f"part '{parts[p]}', operator '{operators[o]}', trial {r + 1}, section {s + 1}: {name} is "
                f"{values[p, o, r, s]:g}, of the part's others {usual[p]:.3g}: in another unit, or a slip?",
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


def refuse_other_units(study: Study, reference_operator: str, where: str) -> None:
    """Refuse an operator, the reference or limits in another unit than the first operator's."""
    for name in (name for name in study.measured if study.unit_of(name) in MISTAKEN):
        samples = {study.operators[o]: study.measured[name][:, o] for o in range(len(study.operators))}
        samples |= {reference_operator: study.reference[name], "its limits": np.array(study.limits.get(name, np.nan))}
        (first, usual), *others = ((who, float(mean_of_seen(np.abs(one), None))) for who, one in samples.items())
        for who, size in others:
            small, large = sorted((usual, size))
            for mistaken, converted in MISTAKEN[study.unit_of(name)].items():
                if abs(converted(small) - large) < ALIKE * large and converted(small) != small:
                    what = f"{name} is {size:.3g} by {who}, {usual:.3g} by {first}: one of them in {mistaken}?"
                    raise InputError(where, f"expected one unit: {what}")


def mean_of_seen(values: Float, axis: tuple[int, ...] | None) -> Float:
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


@stage("compare.study")
def study(
    *,
    study: InputFile | None = None,
    inspections: list[InputFile] = [],  # noqa: B006  (checked and copied before the function sees it)
    reference_operator: Annotated[str, Field(min_length=1)] = "reference",
    root_limits_mm: Limits | None = None,
    bevel_limits_deg: Limits | None = None,
    characteristics: Annotated[list[str], Field(max_length=100)] = [],  # noqa: B006
    columns: dict[Literal["part", "operator", "trial"], str] = {},  # noqa: B006
    limits: dict[str, Limits] = {},  # noqa: B006
    unit: Annotated[str, Field(min_length=1, max_length=12)] = "mm",
) -> Study:
    """Gather the measurements of a gauge study: parts x operators x trials, by section.

    The study is compared with the mean of the measurements by `reference_operator`.

    Args:
        study: CSV that lists inspections (`part,operator,inspection`) or values
            (`part,operator,trial,section,root_mm,...`; docs/comparison.md).
        inspections: instead: inspection.json files, repeats of one part by one operator.
        reference_operator: the study's name for reference measurements.
        root_limits_mm: lower and upper limit of the root face; null: the inspections' own.
        bevel_limits_deg: of the bevel angle, likewise.
        characteristics: columns of a CSV of any gauge to analyse, one value a trial.
        columns: the CSV's names of `part`, `operator` and `trial`, where they differ.
        limits: lower and upper limit of each of the characteristics, where known.
        unit: of characteristics without a unit in their names.

    Raises:
        InputError: unreadable, unbalanced, fewer than two trials, trials that are copies, values in different units,
            a single one of another size.

    Example:
        >>> from workbench import compare
        >>> study = compare.study(study="data/synthetic/gauge_study.csv")
        >>> study.unit
        'mm'
    """
    if (study is None) == (not inspections):
        raise InputError("compare.study", "expected either a study or a list of inspections")
    if characteristics and study is None:
        raise InputError("compare.study", "expected a study, whose columns the characteristics are")
    if columns and not characteristics:
        raise InputError("compare.study.columns", "expected characteristics too: an own study has fixed names")
    if unknown := [name for name in limits if name not in characteristics]:
        raise InputError("compare.study.limits", f"'{unknown[0]}' is not one of the characteristics")
    if study is not None:
        found = measurements_of(study, characteristics, {str(key): name for key, name in columns.items()})
    else:
        found = [read_inspection(path) for path in inspections]
    where = str(study) if study is not None else "inspections"
    mine = [one for one in found if one.operator != reference_operator]
    others = [one for one in found if one.operator == reference_operator]
    cells = balanced(mine, where)
    parts, operators = list(dict.fromkeys(p for p, _ in cells)), list(dict.fromkeys(o for _, o in cells))
    sections = sections_of(mine)
    known = dict.fromkeys(characteristics, "") or CHARACTERISTICS
    table = {  # (P, O, R, S)
        name: np.array(
            [
                [[[one.sections[s].get(name, np.nan) for s in sections] for one in cells[p, o]] for o in operators]
                for p in parts
            ]
        )
        for name in ("arc_length_mm", *known, *known.values())
    }
    names = [name for name in known if np.isfinite(table[name]).any()]
    if not names:
        raise InputError(
            where, f"expected values of {', '.join(characteristics) or 'sizes such as root_mm'}, found none"
        )
    measured = {name: table[name] for name in names}
    refuse_copies(measured, parts, operators, where)
    refuse_slips(measured, parts, operators, where)
    reference = reference_of(others, parts, sections, names)
    given: dict[str, Limits | None] = {"root_mm": root_limits_mm, "bevel_deg": bevel_limits_deg, **limits}
    made = Study(
        parts=tuple(parts),
        operators=tuple(operators),
        trials=len(next(iter(cells.values()))),
        section=sections,
        arc_length_mm=mean_of_seen(table["arc_length_mm"], (0, 1, 2)),
        measured=measured,
        stated_u={name: table[known[name]] for name in names},
        reference={name: value for name, (value, _) in reference.items()},
        reference_u={name: u for name, (_, u) in reference.items()},
        limits={name: held for name in names if (held := limits_of(given.get(name), mine, name, where)) is not None},
        unit=unit,
        files=tuple((one.where, one.digest) for one in found if one.digest),
        part=shared([one.identity for one in found]),
        warnings=apart(table["arc_length_mm"]),
    )
    refuse_other_units(made, reference_operator, where)
    return made
