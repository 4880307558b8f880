"""The page of a gauge study that a quality engineer expects, as a chapter of the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from workbench import pieces
from workbench.artefacts import Chapter
from workbench.compare.agreement import COVERAGE
from workbench.compare.gauge import Component
from workbench.compare.gauge_pictures import gauge_picture
from workbench.compare.gauge_values import Characteristic
from workbench.compare.values import Study

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


def gauge_chapter(study: Study, results: Sequence[Characteristic]) -> Chapter:
    """Tables and pictures of all characteristics."""
    parts = [pieces.facts_html(_facts(study))]
    for one in results:
        parts += _characteristic(study, one)
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
        summary="; ".join(_summary(one) for one in results),
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


def _summary(one: Characteristic) -> str:
    return f"{one.title}: {verdict_in_words(one)}"


def _facts(study: Study) -> list[tuple[str, str]]:
    return [
        ("Parts", f"{len(study.parts)}"),
        ("Operators", f"{len(study.operators)}"),
        ("Trials of each", f"{study.trials}"),
        ("Sections", f"{len(study.section)}"),
    ]


def _characteristic(study: Study, one: Characteristic) -> Iterator[str]:
    unit = study.unit_of(one.name)
    yield pieces.heading(one.title)
    yield pieces.paragraph(f"{verdict_in_words(one)}. {_categories(one)}")
    yield pieces.table_html(HEAD, [_component(part) for part in one.gauge.components], f"Components, {unit}")
    yield pieces.figure_html(
        gauge_picture(study, one),
        f"Gauge study of the {one.title.lower()}",
        f"Colours: operators{', in the chart of biases parts' if len(study.parts) > 1 else ''}. Grey bars: "
        "reference. Dashed: limits.",
    )
    yield pieces.table_html(
        ("Analysis of variance", "Sum of squares", "Degrees of freedom", "Mean square", "F", "p"),
        [
            (
                row.name + (" (with the interaction)" if row.name == "repeatability" and one.anova.pooled else ""),
                f"{row.sum_of_squares:.4g}",
                f"{row.freedom}",
                f"{row.mean_square:.4g}",
                _number(row.f, ".3g"),
                _number(row.p, ".3g"),
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
    return NAMES[part.name], _number(part.sd, ".4f"), interval, *(_number(value, ".1f") for value in percents)


def _sections(study: Study, one: Characteristic) -> Iterator[str]:
    rows = []
    for section in one.sections:
        ev, av, grr = (section.gauge.of(name) for name in ("EV", "AV", "GRR"))
        rows.append(
            (
                f"{section.index}",
                _number(section.arc_length_mm, ".1f"),
                f"{section.mean:.3f}",
                _number(ev.sd, ".4f"),
                _number(av.sd, ".4f"),
                _number(grr.sd, ".4f"),
                _number(grr.tolerance_percent, ".1f"),
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
            _number(np.abs(found.e_n[i, ..., k]).max(), ".2f"),
        )
        for i, part in enumerate(study.parts)
        for k, index in enumerate(study.section)
        if np.isfinite(found.bias[i, k])
    ]
    yield pieces.table_html(
        ("Place", f"Bias, {unit}", f"Expanded uncertainty (k = 2), {unit}", "Largest |E_n|"), rows[:MOST_ROWS]
    )


def _number(value: float | None, form: str) -> str:
    return "–" if value is None or not np.isfinite(value) else format(value, form)
