"""`deviation.json` (docs/comparison.md): strict JSON, mm."""

from __future__ import annotations

import dataclasses

from workbench.artefacts import Document
from workbench.compare.distances import Scales
from workbench.compare.statistics import Summary
from workbench.compare.surface_values import Deviations, Registration, Surface
from workbench.strict_json import strict_json


def deviation_document(
    found: Deviations,
    summary: Summary,
    scan: Surface,
    reference: Surface,
    registration: Registration | None,
    scales: Scales,
) -> Document:
    """The file: the finding, statistics, sections, histogram, and every place."""
    content = {
        "format": "bevel-deviation",
        "version": 1,
        "frame": "base",
        "scan": scan.source,
        "reference": reference.source,
        "reference_kind": "scan"
        if reference.triangles is None
        else "plan"
        if reference.course_mm is not None
        else "mesh",
        "registered": registration is not None,
        "finding": summary.in_words,
        "changed": bool(summary.changed.any()),
        "compared": summary.compared,
        "mean_mm": summary.mean_mm,
        "rms_mm": summary.rms_mm,
        "percentiles_mm": {f"{k}": value for k, value in summary.percentiles_mm.items()},
        "significant_share": summary.significant,
        "level_of_detection_mm": summary.detectable_mm,
        "scales": dataclasses.asdict(scales),
        "arc_length_along": summary.along,
        "sections": [dataclasses.asdict(section) for section in summary.sections],
        "regions": [dataclasses.asdict(region) for region in summary.regions],
        "histogram": {"edges_mm": summary.edges_mm, "counts": summary.counts},
        "places": {
            "position_mm": found.position_mm.round(4),
            "normal": found.normal.round(6),
            "arc_length_mm": found.arc_length_mm.round(3),
            "distance_mm": found.distance_mm.round(5),
            "u_mm": found.u_mm.round(5),
            "level_of_detection_mm": found.detectable_mm.round(5),
            "changed": summary.changed,
        },
    }
    return Document("deviation.json", strict_json(content))
