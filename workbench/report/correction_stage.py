"""The stage `report.correction`: the chapter on a cut that was measured and the finishing pass that it corrects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from workbench.artefacts import Chapter, Characteristic, Inspection, PathCorrection
from workbench.artefacts.paths import CANCELS, NOT_INCLUDED
from workbench.errors import one_line
from workbench.marks import LIMIT
from workbench.pieces import INK, minus
from workbench.report.along import deviation_chart, draw_course, gaps, hatch_hidden, stacked
from workbench.report.tables import check_texts
from workbench.report.text import data_address, render, signed, span
from workbench.stage import stage
from workbench.units import COVERAGE, DEG, Float


def correction_summary(found: PathCorrection, finished: Mapping[str, Inspection]) -> str:
    """The loop in one line."""
    said = [f"refused: {one_line(found.refused)}" if found.refused else found.reason]
    said += [
        f"{name}: mean root face deviation {signed(off[0], 3)} mm"
        for name, one in finished.items()
        if (off := _off(one.characteristics[0]))
    ]
    return minus("; ".join(said))


def _lead(found: PathCorrection) -> str:
    if found.refused:
        return f"The finishing pass is refused: {one_line(found.refused)}."
    said = minus(found.reason[:1].upper() + found.reason[1:])
    return f"{said}. What the first cut left for the finishing pass is {span(found.stock_mm[found.cut], 2, ' mm')}."


def _displaced(found: PathCorrection) -> tuple[tuple[str, str, Float, Float, Float], ...]:
    """Shift and tilt: name, unit; measured, u, and what was corrected (k,) in it."""
    return (
        ("Shift", " mm", found.displacement_mm, found.displacement_u_mm, found.shift_mm),
        ("Tilt", "°", found.turn / DEG, found.turn_u / DEG, found.tilt / DEG),
    )


def _found_rows(found: PathCorrection) -> Iterator[tuple[str, ...]]:
    """Shift and tilt: measured, U, corrected by."""
    cut, none = found.cut, "none: refused" if found.refused else "none: not significant"
    for name, unit, value, u, by in _displaced(found):
        what = span(by[cut], 3, unit) if by.any() else none
        yield name, span(value[cut], 3, unit), f"{COVERAGE * u[cut].max():.3f}{unit}", what


def _finished_rows(finished: Mapping[str, Inspection]) -> Iterator[tuple[str, ...]]:
    for name, one in finished.items():
        cells: list[str] = []
        for what in one.characteristics:
            cells += [signed(value, 2 if what.is_angle else 3) for value in _off(what) or ()] or ["–", "–"]
        yield name, *cells, one.verdict


def _off(what: Characteristic) -> tuple[float, float] | None:
    """Mean and greatest deviation of the sections from nominal; None where none was measured."""
    known = np.array([pair[0] - what.required[0] for pair in what.pairs if pair and what.required])
    return (float(known.mean()), float(known[np.argmax(np.abs(known))])) if len(known) else None


def correction_chart(found: PathCorrection) -> bytes:
    """SVG of shift and tilt along the edge, and of what was corrected."""
    over = (found.arc_length_mm >= 0.0) & (found.arc_length_mm <= found.length_mm)
    s = found.arc_length_mm[over]
    figure, (top, below) = stacked()
    for axes, (*_, value, u, by) in zip((top, below), _displaced(found), strict=True):
        draw_course(axes, s, value[over], u[over])
        axes.plot(s, -by[over], color=INK, linewidth=1.0, dashes=(5, 3))
        axes.axhline(0.0, color=INK, linewidth=0.5)
        hatch_hidden(axes, gaps(s, found.cut[over]))
    for limit in (-found.allowance_mm, found.allowance_mm):
        top.axhline(limit, color=LIMIT, linewidth=0.8, dashes=(8, 2, 1.5, 2))
    top.set(xlim=(float(s[0]), float(s[-1])), ylabel="shift of the cut, mm")
    below.set(ylabel="tilt of the cut, °", xlabel="arc length along the lower edge, as planned, mm")
    return figure.svg()


@stage("report.correction")
def correction(
    correction: PathCorrection,
    first: Inspection,
    corrected: Inspection | None = None,
    blind: Inspection | None = None,
) -> Chapter:
    """The measured loop as a chapter: the first cut beside its plan, the correction, the finished part beside one
    milled without it.

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
    finished = {
        name: one
        for name, one in (("blind", blind if blind is not corrected else None), ("corrected", corrected))
        if one is not None and one is not first
    }
    asked = {size: nominal for one in finished.values() for size, (nominal, _) in one.required.items()}
    return Chapter(
        title="Measured correction",
        html=render(
            "correction.html.j2",
            lead=_lead(correction),
            found=list(_found_rows(correction)),
            chart=data_address(correction_chart(correction)),
            checks=[
                (*check_texts(c.name, c.value, c.limit), "passed" if c.passed else one_line(c.finding))
                for c in correction.checks
            ],
            cancels=CANCELS,
            not_included=NOT_INCLUDED,
            repeatability=f"{correction.repeatability_mm:g}",
            alone=f"{COVERAGE * correction.repeatability_mm / math.sin(correction.bevel):.2f}",
            parts_before=0 if correction.batch is None else correction.batch.parts - 1,
            finished=list(_finished_rows(finished)),
            parts=data_address(deviation_chart(finished, asked)) if finished else "",
        ),
        verdict="fail" if correction.refused else "",
        summary=correction_summary(correction, finished),
        part=correction.part,
        warnings=tuple(map(one_line, correction.warnings)),
    )
