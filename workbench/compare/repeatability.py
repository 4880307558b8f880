"""`compare.repeatability`: repeatability, reproducibility and bias of root face and bevel angle."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from workbench.artefacts import Chapter, Document
from workbench.compare.agreement import agreement
from workbench.compare.anova import analyse
from workbench.compare.gauge import gauge
from workbench.compare.gauge_chapter import gauge_chapter
from workbench.compare.gauge_document import gauge_document
from workbench.compare.gauge_values import Characteristic, SectionGauge, seen_everywhere
from workbench.compare.values import Study
from workbench.stage import stage


@stage("compare.repeatability")
def repeatability(
    study: Study,
    *,
    interaction_alpha: Annotated[
        float, Field(gt=0, lt=1, description="share of false alarms at which part x operator counts as an interaction")
    ] = 0.05,
) -> tuple[Document, Chapter]:
    """Judge the measuring system by repeated measurements: gauge R&R by analysis of variance, bias, E_n.

    Repeatability (EV), reproducibility (AV) and part variation (PV) as AIAG's Measurement Systems Analysis (4th ed.
    2010) names them, for every section by itself and for all of them; %GRR of the tolerance and of the study
    variation, number of distinct categories, all with 95 % intervals. Where the study has reference measurements: bias
    with its uncertainty by section, and E_n numbers (ISO 13528; ISO/IEC 17043) by the uncertainties that both sides
    state.

    Args:
        study: parts x operators x trials by section.
        interaction_alpha: level at which the interaction is tested; one that is not significant is pooled.

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
