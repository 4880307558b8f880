"""`repeatability.json` (docs/comparison.md): strict JSON, values in the unit that the characteristic's name ends in."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from workbench.artefacts import Document
from workbench.compare.gauge import Gauge
from workbench.compare.gauge_values import Characteristic
from workbench.compare.values import Study
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
        "characteristics": [_characteristic(study, one) for one in results],
        "inspections": [{"file": path, "sha256": digest} for path, digest in study.files],
        "warnings": [*study.warnings, *(words for one in results for words in one.warnings)],
    }
    return Document("repeatability.json", strict_json(content))


def _characteristic(study: Study, one: Characteristic) -> dict[str, Any]:
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
