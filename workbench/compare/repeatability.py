"""`compare.repeatability`: repeatability, reproducibility and bias of root face and bevel angle; repeatability.json."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.artefacts import Chapter, Document
from workbench.compare.gauge import Characteristic, Gauge, SectionGauge, agreement, analyse, gauge, seen_everywhere
from workbench.compare.gauge_chapter import gauge_chapter
from workbench.compare.measurements import Study
from workbench.stage import stage
from workbench.strict_json import strict_json


def gauge_document(study: Study, results: Sequence[Characteristic]) -> Document:
    """The file."""
    content = {
        "format": "bevel-repeatability",
        "version": 1,
        "part": dataclasses.asdict(study.part),
        "parts": list(study.parts),
        "operators": list(study.operators),
        "trials": study.trials,
        "characteristics": [_characteristic_json(study, one) for one in results],
        "inspections": [{"file": path, "sha256": digest} for path, digest in study.files],
        "warnings": [*study.warnings, *(words for one in results for words in one.warnings)],
    }
    return Document("repeatability.json", strict_json(content))


def _characteristic_json(study: Study, one: Characteristic) -> dict[str, Any]:
    found = one.agreement
    return {
        "name": one.name,
        "unit": study.unit_of(one.name),
        "limits": one.limits,
        "anova": [{**dataclasses.asdict(row), "mean_square": row.mean_square} for row in one.anova.sources],
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
                "largest_e_n": _largest(found.e_n[i, ..., k]),
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
        "components": [dataclasses.asdict(part) for part in gauge.components],
        "distinct_categories": gauge.categories,
    }


def _largest(e_n: Any) -> float | None:
    """The E_n number farthest from 0."""
    seen = e_n[np.isfinite(e_n)]
    return float(seen[np.argmax(np.abs(seen))]) if seen.size else None


@stage("compare.repeatability")
def repeatability(
    study: Study,
    *,
    interaction_alpha: Annotated[float, Field(gt=0, lt=1)] = 0.05,
) -> tuple[Document, Chapter]:
    """Judge the measuring system by repeated measurements: gauge R&R by analysis of variance, bias, E_n.

    As AIAG's Measurement Systems Analysis names them, for every section by itself and for all of them
    (docs/comparison.md): EV, AV, PV, %GRR of the tolerance and of the study variation, number of distinct categories,
    with 95 % intervals; with reference measurements bias by section, and E_n.

    Args:
        study: parts x operators x trials by section.
        interaction_alpha: share of false alarms at which part x operator counts as an interaction; one that is not
            significant is pooled.

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
