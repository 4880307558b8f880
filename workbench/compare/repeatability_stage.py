"""`compare.repeatability`: repeatability, reproducibility and bias of root face and bevel angle; repeatability.json."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench import pieces
from workbench.artefacts import Chapter, Document
from workbench.compare.gauge import (
    Characteristic,
    Component,
    Gauge,
    SectionGauge,
    agreement,
    analyse,
    confused,
    gauge,
    seen_everywhere,
)
from workbench.compare.measurements import Study
from workbench.marks import LIMIT, Lettering
from workbench.pieces import GREY, ORANGE, PALE, SERIES, number
from workbench.plot import Axes, Figure
from workbench.result_files import result_file
from workbench.stage import stage
from workbench.units import COVERAGE, Float

GOOD_PERCENT, BAD_PERCENT = 10.0, 30.0  # AIAG: %GRR below, above which a gauge is acceptable, is not
LEAST_CATEGORIES = 5  # AIAG
MOST_ROWS = 60  # of the table of biases
NAMES = {
    "EV": "Repeatability (EV)",
    "AV": "Reproducibility (AV)",
    "GRR": "Gauge R&R (GRR)",
    "PV": "Part variation (PV)",
    "TV": "Total (TV)",
}
HEAD = ("Source", "Standard deviation", "95 % interval", "% contribution", "% study variation", "% tolerance")
NORMAL = "A ratio below 1 is expected: the stated uncertainty also covers errors common to all recordings."


def gauge_document(study: Study, results: Sequence[Characteristic]) -> Document:
    """The file."""
    content = {
        "part": dataclasses.asdict(study.part),
        "parts": list(study.parts),
        "operators": list(study.operators),
        "trials": study.trials,
        "characteristics": [_characteristic_json(study, one) for one in results],
        "inspections": [{"file": path, "sha256": digest} for path, digest in study.files],
        "warnings": [*study.warnings, *(words for one in results for words in one.warnings)],
    }
    return result_file("repeatability.json", content)


def _characteristic_json(study: Study, one: Characteristic) -> dict[str, Any]:
    found = one.agreement
    return {
        "name": one.name,
        "unit": study.unit_of(one.name),
        "limits": one.limits,
        "anova": [{**row._asdict(), "mean_square": row.mean_square} for row in one.anova.sources],
        "interaction_pooled": one.anova.pooled,
        "correlation_between_sections": one.anova.correlation,
        **_gauge(one.gauge),
        "sections": [
            {
                "index": section.index,
                "arc_length_mm": section.arc_length_mm,
                "mean": section.mean,
                **_gauge(section.gauge),
            }
            for section in one.sections
        ],
        "bias": [
            {
                "part": part,
                "section": index,
                "bias": found.bias[i, k],
                "u": found.bias_u[i, k],
                "largest_e_n": max(found.e_n[i, ..., k][np.isfinite(found.e_n[i, ..., k])], key=abs, default=None),
            }
            for i, part in enumerate(study.parts)
            for k, index in enumerate(study.section)
        ]
        if found.has_reference
        else [],
        "observed_over_stated_uncertainty": found.observed_over_stated,
    }


def _gauge(gauge: Gauge) -> dict[str, Any]:
    return {
        "components": [part._asdict() for part in gauge.components],
        "distinct_categories": gauge.categories,
    }


@stage("compare.repeatability")
def repeatability(
    study: Study,
    *,
    interaction_alpha: Annotated[float, Field(gt=0, lt=1)] = 0.05,
) -> tuple[Document, Chapter]:
    """Judge the measuring system by repeated measurements: gauge R&R by analysis of variance, bias, E_n.

    By AIAG's manual, by section and for all, with 95 % intervals (docs/comparison.md).

    Args:
        study: parts x operators x trials by section.
        interaction_alpha: significance level (a share) of the part x operator interaction, which is pooled if not
            significant.

    Raises:
        InputError: no section in which every recording has a value.

    Example:
        >>> from workbench import compare
        >>> study = compare.study(study="data/synthetic/gauge_study.csv")
        >>> results, chapter = compare.repeatability(study)
        >>> chapter.title
        'Repeatability and reproducibility'
    """
    results = tuple(_characteristic(study, name, interaction_alpha) for name in study.measured)
    return gauge_document(study, results), gauge_chapter(study, results)


def _characteristic(study: Study, name: str, interaction_alpha: float) -> Characteristic:
    """All about one characteristic: over all sections that every recording shows, and in each."""
    use, warnings = seen_everywhere(study, name)
    limits = study.limits.get(name)
    width = None if limits is None else limits[1] - limits[0]
    values = study.measured[name][..., use]
    anova = analyse(values, interaction_alpha)
    if not anova.pooled:
        warnings += confused(values, study, name)
    sections = tuple(
        SectionGauge(
            study.section[k],
            float(study.arc_length_mm[k]),
            float(study.measured[name][..., k].mean()),
            gauge(analyse(study.measured[name][..., k : k + 1], interaction_alpha), width),
        )
        for k in use
    )
    overall = gauge(anova, width)
    return Characteristic(name, limits, anova, overall, sections, agreement(study, name, overall), warnings)


def gauge_chapter(study: Study, results: Sequence[Characteristic]) -> Chapter:
    """Tables and pictures of all characteristics."""
    parts = [pieces.facts_html(_facts(study))]
    for one in results:
        parts += _characteristic_html(study, one)
    parts.append(
        pieces.note(
            "Sections of one recording share errors, so each section is analysed by itself and sums of squares are "
            "averaged. Intervals are 95 % generalised confidence intervals. %GRR follows AIAG: six standard deviations "
            f"over the tolerance, standard deviation over the total; below {GOOD_PERCENT:g} % acceptable, above "
            f"{BAD_PERCENT:g} % not."
        )
    )
    return Chapter(
        "Repeatability and reproducibility",
        "\n".join(parts),
        summary="; ".join(f"{one.title}: {verdict_in_words(one)}" for one in results),
        part=study.part,
        about="instruments",
        warnings=(*study.warnings, *(words for one in results for words in one.warnings)),
    )


def verdict_in_words(one: Characteristic) -> str:
    """AIAG's judgement by the share of the tolerance, or else of the study variation, and by the distinct categories.

    A gauge is acceptable by both criteria or not at all.
    """
    grr, categories = one.gauge.of("GRR"), one.gauge.categories
    share, of = grr.tolerance_percent, "the tolerance"
    if share is None:
        share, of = grr.study_percent, "the study variation"
    if share is None:
        return "neither a tolerance nor part variation: not judged"
    words = "acceptable" if share < GOOD_PERCENT else "may be acceptable, depending on use"
    if share > BAD_PERCENT:
        words = "not acceptable"
    elif categories is not None and categories < LEAST_CATEGORIES:
        words = f"not acceptable: ndc {categories}, at least {LEAST_CATEGORIES} required"
    return f"GRR {share:.1f} % of {of}: {words}"


def _facts(study: Study) -> list[tuple[str, str]]:
    return [
        ("Parts", f"{len(study.parts)}"),
        ("Operators", f"{len(study.operators)}"),
        ("Trials of each", f"{study.trials}"),
        ("Sections", f"{len(study.section)}"),
    ]


def _characteristic_html(study: Study, one: Characteristic) -> Iterator[str]:
    unit = study.unit_of(one.name)
    yield pieces.heading(one.title)
    yield pieces.paragraph(f"{verdict_in_words(one)}. {_categories(one)}")
    yield pieces.table_html(HEAD, [_component(part) for part in one.gauge.components], f"Components, {unit}")
    yield pieces.figure_html(
        gauge_picture(study, one),
        f"Gauge study of the {one.title.lower()}",
        "Grey bars: reference. Dashed: limits."
        if one.agreement.has_reference
        else "Dashed: limits. Without reference measurements there is no chart of biases.",
        _key(study, one),
    )
    yield pieces.table_html(
        ("Analysis of variance", "Sum of squares", "Degrees of freedom", "Mean square", "F", "p"),
        [
            (
                row.name + (" (with the interaction)" if row.name == "repeatability" and one.anova.pooled else ""),
                f"{row.sum_of_squares:.4g}",
                f"{row.freedom}",
                f"{row.mean_square:.4g}",
                number(row.f, ".3g"),
                number(row.p, ".3g"),
            )
            for row in one.anova.sources
        ],
    )
    yield from _sections(study, one)
    yield from _agreement(study, one)


def _categories(one: Characteristic) -> str:
    found = one.gauge.categories
    if found is None:
        return "The number of distinct categories (ndc) needs more than one part."
    enough = "" if found >= LEAST_CATEGORIES else f" (AIAG: at least {LEAST_CATEGORIES})"
    return f"Number of distinct categories (ndc): {found}{enough}."


def _component(part: Component) -> tuple[str, ...]:
    interval = "–" if part.interval is None else f"{part.interval[0]:.4f} to {part.interval[1]:.4f}"
    percents = (part.contribution_percent, part.study_percent, part.tolerance_percent)
    return (
        NAMES[part.name],
        number(part.sd, ".4f"),
        interval,
        *(number(value, ".1f") for value in percents),
    )


def _sections(study: Study, one: Characteristic) -> Iterator[str]:
    rows = []
    for section in one.sections:
        ev, av, grr = (section.gauge.of(name) for name in ("EV", "AV", "GRR"))
        rows.append(
            (
                f"{section.index}",
                number(section.arc_length_mm, ".1f"),
                f"{section.mean:.3f}",
                number(ev.sd, ".4f"),
                number(av.sd, ".4f"),
                number(grr.sd, ".4f"),
                number(grr.tolerance_percent, ".1f"),
            )
        )
    head = ("Section", "Arc length, mm", "Mean", "EV", "AV", "GRR", "GRR, % tolerance")
    yield pieces.table_html(head, rows, f"By section, {study.unit_of(one.name)}")


def _agreement(study: Study, one: Characteristic) -> Iterator[str]:
    found, unit = one.agreement, study.unit_of(one.name)
    if np.isfinite(found.observed_over_stated):
        yield pieces.paragraph(
            f"Observed repeatability over stated uncertainty: {found.observed_over_stated:.2f}. {NORMAL}"
        )
    if not found.has_reference:
        return
    largest = np.abs(found.e_n[np.isfinite(found.e_n)])
    words = (
        f"{found.significant} of {int(np.isfinite(found.bias).sum())} biases exceed their expanded uncertainty (k = 2)."
    )
    if largest.size:
        above = int((largest > 1).sum())
        words += f" |E_n| is above 1 in {above} of {largest.size} measurements, at most {largest.max():.2f}."
    yield pieces.paragraph(words)
    rows = [
        (
            f"{part}, section {index}",
            f"{found.bias[i, k]:+.4f}",
            f"{COVERAGE * found.bias_u[i, k]:.4f}",
            number(np.abs(found.e_n[i, ..., k]).max(), ".2f"),
        )
        for i, part in enumerate(study.parts)
        for k, index in enumerate(study.section)
        if np.isfinite(found.bias[i, k])
    ]
    yield pieces.table_html(
        ("Place", f"Bias, {unit}", f"Expanded uncertainty (k = 2), {unit}", "Largest |E_n|"), rows[:MOST_ROWS]
    )


# Pictures of a gauge study: components of variation, values by section and operator, ranges, bias.


def _key(study: Study, one: Characteristic) -> list[tuple[str, str]]:
    """What the colours mean, where none repeats: operators, in the chart of biases parts."""
    kinds = [("operator", study.operators), ("part", study.parts if one.agreement.has_reference else ())]
    every = [[f"{kind} {name}" for name in names] for kind, names in kinds if 1 < len(names) <= len(SERIES)]
    return [(ink, ", ".join(filter(None, names))) for ink, names in zip(SERIES, zip_longest(*every), strict=False)]


def gauge_picture(study: Study, one: Characteristic) -> bytes:
    """Charts about one characteristic, as SVG: four, without references three."""
    figure = Figure(figsize=(10, 6.6))
    components, values, ranges, bias = figure.subplots(2, 2)
    _components(components, study, one)
    _values(values, study, one)
    _ranges(ranges, study, one)
    _bias(bias, study, one)
    return figure.svg()


def _components(axes: Axes, study: Study, one: Characteristic) -> None:
    """Standard deviations with their intervals."""
    shown = [(part, part.sd, part.interval) for part in one.gauge.components if part.sd is not None and part.interval]
    end = max(min(3.0 * max(sd for _, sd, _ in shown), 1.05 * max(high for *_, (_, high) in shown)), 1e-9)
    for row, (part, sd, (low, high)) in enumerate(shown):
        up = row + np.array([-0.3, 0.3])
        axes.fill([0.0, sd, sd, 0.0], np.repeat(up, 2), facecolor=ORANGE if part.name == "GRR" else SERIES[0])
        ends = row + np.array([-0.1, 0.1, 0.0, 0.0, 0.1, -0.1])
        axes.plot(np.repeat([low, high], 3), ends, color=GREY, linewidth=1.4)
        if high > end:  # said, not cut off without a word
            axes.annotate(f"to {high:.3g} \u25b6", (end, row), (-2.0, 7.0), ha="right", look=Lettering(GREY))
    axes.set(xlim=(0.0, end), ylim=(len(shown) - 0.5, -0.5), xlabel=study.unit_of(one.name))
    axes.set(yticks=(range(len(shown)), [part.name for part, *_ in shown]))
    axes.set(title="Components of variation, standard deviation with 95 % interval")


def _values(axes: Axes, study: Study, one: Characteristic) -> None:
    """Every measurement by section; operators side by side."""
    _by_operator(axes, study, study.measured[one.name])
    reference = study.reference[one.name]
    for row in reference[np.isfinite(reference).any(axis=1)]:
        across = np.add.outer(np.arange(len(row)), [-0.1, 0.1, np.nan])
        axes.plot(across, np.repeat(row, 3), color=GREY, linewidth=1.0, zorder=0.5)
    low, high = axes.get_ylim()
    for limit in one.limits or ():
        if low - 0.5 * (high - low) < limit < high + 0.5 * (high - low):
            axes.axhline(limit, color=LIMIT, linewidth=0.9, dashes=(4.0, 2.0))
    axes.set(title="Measurements by section and operator", ylabel=study.unit_of(one.name))


def _by_operator(axes: Axes, study: Study, values: Float) -> None:
    """Values (parts, operators, ..., sections) over the sections."""
    for j in range(len(study.operators)):
        across = np.broadcast_to(_offsets(study, j, len(study.operators)), values[:, j].shape)
        axes.points(across, values[:, j], ".", color=SERIES[j % len(SERIES)])
    _by_section(axes, study)


def _offsets(study: Study, k: int, count: int) -> Float:
    """Places (S,) of the k-th of `count` beside each other at every section."""
    return np.asarray(np.arange(len(study.section)) + 0.5 * ((k + 0.5) / count - 0.5), float)


def _ranges(axes: Axes, study: Study, one: Characteristic) -> None:
    """Range of the trials of each part, operator and section (R chart)."""
    spread = np.ptp(study.measured[one.name], axis=2)
    _by_operator(axes, study, spread)
    axes.axhline(float(np.nanmean(spread)), color=GREY, linewidth=0.9)
    axes.set(ylim=(0.0, None), title="Range of the trials; line: its mean", ylabel=study.unit_of(one.name))


def _bias(axes: Axes, study: Study, one: Characteristic) -> None:
    """Mean less reference, with its expanded uncertainty."""
    found, count = one.agreement, len(study.parts)
    axes.visible = found.has_reference
    axes.axhline(0.0, color=PALE, linewidth=0.8)
    for i, k in np.argwhere(np.isfinite(found.bias)):
        u = COVERAGE * found.bias_u[i, k]
        axes.errorbar(_offsets(study, i, count)[k], found.bias[i, k], u, color=SERIES[i % len(SERIES)])
    _by_section(axes, study)
    axes.set(title="Bias against the reference, with expanded uncertainty (k = 2)", ylabel=study.unit_of(one.name))


def _by_section(axes: Axes, study: Study) -> None:
    axes.set(xlabel="section", xticks=(range(len(study.section)), [str(index) for index in study.section]))
