"""The stage `report.correction`: the chapter on a cut that was measured and the finishing pass that it corrects."""

from __future__ import annotations

from workbench.artefacts import Chapter, Inspection, PathCorrection
from workbench.errors import one_line
from workbench.stage import stage


@stage("report.correction")
def correction(
    correction: PathCorrection,
    first: Inspection,
    corrected: Inspection | None = None,
    blind: Inspection | None = None,
) -> Chapter:
    """The measured loop as a chapter: how the first cut came out beside its plan, what the finishing pass was
    corrected by, and, where they were inspected, the part as finished beside one that was milled blindly.

    Args:
        correction: what `path.correct` found and did.
        first: inspection of the first cut, which it rests on.
        corrected: inspection of the finished part; the same as `first`: not yet finished.
        blind: inspection of a part that was milled without looking; the same as another: there is none.

    Example:
        >>> from workbench import edge, inspect, path, report, scan, twin
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points, finish_allowance_mm=0.5), points, raw)
        >>> part, engagement = twin.mill(twin.part(recipe="data/synthetic/raw_edge.json"), plan)
        >>> found = inspect.sections(edge.segment(scan.fuse(twin.scan(part))))
        >>> finishing, correction = path.correct(found, plan)
        >>> report.correction(correction, found).title
        'Measured correction'
    """
    # jinja2 and pillow cost time to import: only where a report is made.
    from workbench.report.correction_text import correction_html, correction_summary

    finished = {
        name: one
        for name, one in (("blind", blind if blind is not corrected else None), ("corrected", corrected))
        if one is not None and one is not first
    }
    return Chapter(
        title="Measured correction",
        html=correction_html(correction, finished),
        verdict="fail" if correction.refused else "",
        summary=correction_summary(correction, finished),
        warnings=tuple(map(one_line, correction.warnings)),
    )
