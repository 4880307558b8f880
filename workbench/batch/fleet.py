"""The page of the fleet: how the parts came out, and what they say of the process that made them."""

from __future__ import annotations

import io
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from workbench import __version__
from workbench.artefacts import u_name
from workbench.artefacts.edges import ALL_TERMS, BEVEL_TERMS, named, required_in_file
from workbench.batch.control import LEAST, RULES, Capability, ControlChart, capability, individuals
from workbench.batch.part import OUTCOMES, RECORDING, Record
from workbench.errors import one_line
from workbench.extras import Extra
from workbench.marks import LIMIT, MEASURED, REJECTED, TOLERANCE
from workbench.pieces import BLUE, GREEN, GREY, INK, ORANGE, SKY
from workbench.plot import Axes, Figure
from workbench.units import COVERAGE, Float, Int, Shaped

COPIED = "the same recording as {}, byte for byte, and counted again"
NUMBERED = "has part number {} as {} has"
ROWS = 2000  # parts in the table of the page; the rest are in fleet.parquet
SHOWN = 25  # of them at once; the others unfold
SIGNALS = 60  # of run rules in the page
SIGNIFICANT = 0.01


class Study(NamedTuple):
    """One characteristic over all parts: a chart and a capability for each section, and for the parts' means."""

    what: Characteristic
    charts: tuple[ControlChart, ...]
    sections: tuple[Capability, ...]
    whole: Capability  # of the mean over a part's sections; its trend alone is used


def fleet_files(records: Sequence[Record], title: str) -> dict[str, bytes]:
    """`fleet.html` and `fleet.parquet` of all parts, in the order given."""
    told = with_copies(records)
    return {"fleet.html": page(told, title).encode(), "fleet.parquet": parquet(told)}


def study(what: Characteristic) -> Study:
    """What the parts say of one characteristic."""
    columns = range(what.value.shape[1])
    limits = what.lower, what.upper
    return Study(
        what,
        tuple(individuals(what.value[:, k]) for k in columns),
        tuple(capability(what.value[:, k], what.u[:, k], *limits) for k in columns),
        capability(part_means(what), np.zeros(len(what.value)), *limits),
    )


def page(records: Sequence[Record], title: str) -> str:
    """The page, complete in one file; every name in it is escaped."""
    from workbench.report.text import source
    from workbench.templates import environment

    found = characteristics(records)
    margin, section = least_margin(found) if found else (np.full(len(records), np.nan), np.full(len(records), -1))
    places = {record.part: i for i, record in enumerate(records)}
    ranked = worst_first(records)
    return (
        environment("workbench.batch")
        .get_template("fleet.html.j2")
        .render(
            style=source("page.css"),
            title=one_line(title),
            version=__version__,
            counts=[(one, sum(record.outcome == one for record in records)) for one in reversed(OUTCOMES)],
            inspected=bool(found),
            total=len(records),
            cover=cover(records),
            rows=[row(one, places[one.part], margin, section) for one in ranked[:ROWS]],
            shown=SHOWN,
            left_out=max(0, len(ranked) - ROWS),
            **(_statistics(records, found) if found else {}),
        )
    )


# An absolute path of a file: its last name has an ending, which places inside an HDF5 file (/profiles/x) have not.
ABSOLUTE = re.compile(r"(?<![\w:/.\\])(?:[A-Za-z]:[\\/]|/)(?:[^\s:'\"/\\]+[\\/])+([^\s:'\"/\\]+\.\w+)")


def without_folders(text: str, recording: str) -> str:
    """A message with absolute paths shown by the file's name: a page that is passed on tells nothing of the machine."""
    kind = next((one for one in (PurePosixPath, PureWindowsPath) if one(recording).is_absolute()), None)
    return ABSOLUTE.sub(r"\1", text.replace(recording, kind(recording).name) if kind else text)


def row(record: Record, place: int, margin: Any, section: Any) -> dict[str, Any]:
    """One part in the table."""
    report = next((name for name in ("report.html", "run.json") if name in record.files), "part.json")
    return {
        "order": place + 1,
        "name": record.part,
        "id": one_line(record.part_id or ""),
        "link": f"{quote(record.part)}/{report}",
        "outcome": record.outcome,
        "verdict": record.verdict or "",
        "margin": "" if np.isnan(margin[place]) else f"{100 * margin[place]:.0f} %",
        "section": "" if section[place] < 0 else str(section[place] + 1),
        "cause": without_folders(one_line(record.cause), record.recording),
    }


def with_copies(records: Sequence[Record]) -> list[Record]:
    """The records; one whose recording, byte for byte, or part number is that of a part before says so in its cause."""
    first, numbered, found = dict[str, str](), dict[str, str](), list[Record]()
    for one in records:
        digest = next((given["sha256"] for given in one.inputs if given["name"] == RECORDING), None)
        before = first.setdefault(digest, one.part) if digest else one.part
        alike = numbered.setdefault(one.part_id, one.part) if one.part_id else one.part
        cause = [one.cause] * bool(one.cause)
        if before != one.part:
            cause.append(COPIED.format(before))
        elif alike != one.part:
            cause.append(NUMBERED.format(one_line(one.part_id or ""), alike))
        found.append(replace(one, cause="; ".join(cause)))
    return found


def _statistics(records: Sequence[Record], found: Sequence[Characteristic]) -> Mapping[str, Any]:
    from workbench.report.text import data_address

    studies = [study(what) for what in found]
    counts = worst_counts(found)
    signals = [one for each in studies for one in _signals(each, records)]
    return {
        "studies": studies,
        "pictures": [data_address(control_charts(one.what, one.charts)) for one in studies],
        "trend": data_address(trend_chart(studies)),
        "worst": data_address(worst_chart(found, counts)),
        "worst_text": worst_text(counts),
        "signals": signals[:SIGNALS],
        "more_signals": max(0, len(signals) - SIGNALS),
        "expected": sum(len(chart.value) for one in studies for chart in one.charts) * 0.0027,
        "few": max(chart.order.size for one in studies for chart in one.charts) < LEAST,
        "least": LEAST,
    }


def _signals(one: Study, records: Sequence[Record]) -> list[dict[str, Any]]:
    """What the run rules say, in the order of parts; sections that say the same are one line."""
    names = {0: "moving range beyond its limit"} | {n: f"Nelson {n}: {text}" for n, text in RULES.items()}
    by_part: dict[tuple[int, int], list[str]] = {}
    for k, chart in enumerate(one.charts, 1):
        for at, rule in chart.signals:
            by_part.setdefault((int(chart.order[at]), rule), []).append(str(k))
    return [
        {
            "what": one.what.name,
            "sections": ", ".join(sections),
            "order": place + 1,
            "part": records[place].part,
            "rule": names[rule],
        }
        for (place, rule), sections in sorted(by_part.items())
    ]


def worst_counts(found: Sequence[Characteristic]) -> Int:
    """(characteristics, sections) in how many parts that section, by that characteristic, has the smallest margin."""
    margin = np.stack([np.where(np.isnan(one.margin), np.inf, one.margin) for one in found], axis=1)  # (P, C, S)
    flat = margin.reshape(len(margin), -1)
    measured = np.isfinite(flat).any(axis=1)
    return np.bincount(np.argmin(flat[measured], axis=1), minlength=flat.shape[1]).reshape(margin.shape[1:])


def worst_text(counts: Int) -> str:
    """Which section is the worst most often, and whether that is more than chance."""
    from scipy.special import bdtrc

    by_section, parts, sections = counts.sum(axis=0), int(counts.sum()), counts.shape[1]
    if sections < 2 or not parts:
        return ""
    worst = int(np.argmax(by_section))
    chance = min(1.0, sections * float(bdtrc(int(by_section[worst]) - 1, parts, 1 / sections)))
    frequency = (
        "significantly more often than by chance"
        if chance < SIGNIFICANT
        else "not significantly more often than by chance"
    )
    return (
        f"Section {worst + 1} has the smallest margin in {by_section[worst]} of {parts} parts ({parts / sections:.1f} "
        f"expected for each section): {frequency} (p = {chance:.2g}, binomial, times {sections} sections)."
    )


# The first page of the fleet's report, for a customer: every part with its verdict and uncertainty on one A4 side.

MOST_PARTS = 80  # two columns of rows of 5 mm under the head
VERDICTS = ("fail", "undecided", "pass")  # least favourable first
CONFORMITY = {"pass": "conform", "fail": "do not conform", "undecided": "undecided"}
MOST_SIZES = 2  # that a row has room for


def cover(records: Sequence[Record]) -> dict[str, Any]:
    """What the template `cover` takes."""
    measured = [one for one in records if one.sections]
    needs = measured[0].requirements if measured else {}
    alike = all(one.requirements == needs for one in measured)
    ranked = sorted(measured, key=lambda one: VERDICTS.index(one.verdict) if one.verdict in VERDICTS else 0)
    shown = measured if len(measured) <= MOST_PARTS else ranked[:MOST_PARTS]
    sizes = [*required_in_file(needs)]
    sizes = sizes if len(sizes) <= MOST_SIZES else []
    drawings = {str(one.identity["drawing"]) for one in measured if one.identity.get("drawing")}
    return {
        "measured": len(measured),
        "unmeasured": [(one.part, one.outcome) for one in records if not one.sections],
        "verdicts": [
            (CONFORMITY[name], name, sum(one.verdict == name for one in measured))
            for name in ("pass", "fail", "undecided")
        ],
        "limits": [_limits(name, wanted) for name, wanted in required_in_file(needs).items()] if alike else [],
        "sizes": [f"{ALL_TERMS[one][1]} ± U, {'°' if one.endswith('_deg') else 'mm'}" for one in sizes],
        "drawings": one_line(", ".join(sorted(drawings))) or "unknown",
        "rows": [_row(one, sizes, [each.part_id for each in measured].count(one.part_id) > 1) for one in shown],
        "not_shown": len(measured) - len(shown),
        "simulated": any(one.identity.get("simulated") for one in records),
    }


def _row(record: Record, sizes: Sequence[str], shared: bool) -> dict[str, Any]:
    """One part: name, verdict, and the range of each of the sizes with the largest expanded uncertainty.

    Where others share its name its recording's stands beside it.
    """
    name = f"{record.part_id[:36]} ({record.part})" if record.part_id and shared else record.part_id or record.part
    return {
        "name": one_line(name)[:60],
        "verdict": record.verdict or "",
        "cells": [_cell(record, size) for size in sizes],
    }


def _cell(record: Record, size: str) -> str:
    rows = [one for one in record.sections if one.get(size) is not None]
    if not rows:
        return "–"
    places = 2 if size.endswith("_deg") else 3
    values = [float(one[size]) for one in rows]
    u = max(float(one[u_name(size)]) for one in rows)
    return f"{min(values):.{places}f} to {max(values):.{places}f} ± {COVERAGE * u:.{places}f}"


def _limits(size: str, wanted: tuple[float, tuple[float, float]]) -> str:
    nominal, (lower, upper) = wanted
    term, letter = ALL_TERMS[size]
    return (
        f"{term.lower()} {letter} {nominal + lower:g} to {nominal + upper:g}{'°' if size.endswith('_deg') else ' mm'}"
    )


COLUMNS = 3  # of small charts side by side
WIDE_IN, CELL_IN = 10.4, 2.6  # of a figure; height of a small chart
WITH_DOTS = 60  # parts up to which each value has a dot
COLOURS = (BLUE, ORANGE, GREEN, "#cc79a7", "#e69f00", SKY)  # of the characteristics, in turn


def control_charts(what: Characteristic, charts: Sequence[ControlChart]) -> bytes:
    """SVG: for each section the values over the moving ranges, with limits; signals stand out."""
    rows = math.ceil(len(charts) / COLUMNS)
    height = CELL_IN * rows + 0.2
    figure = Figure(figsize=(WIDE_IN, height))
    for k, chart in enumerate(charts):
        row, column = divmod(k, COLUMNS)
        left, top = 0.07 + 0.32 * column, height - CELL_IN * row
        places = ((top - 1.8, 1.5), (top - 2.3, 0.42))  # inches up, and high
        values, ranges = (figure.add_axes((left, low / height, 0.27, high / height)) for low, high in places)
        values.labelled["x"] = False
        for axes in (values, ranges):
            axes.integer = "x"
            axes.set(xlim=(0.5, max(1, *(chart.order + 1)) + 0.5))
        _draw_values(values, chart, what, f"section {k + 1}")
        _draw_ranges(ranges, chart)
        if column == 0:
            values.set(ylabel=f"{what.name}, {what.unit}")
            ranges.set(ylabel="range")
        if row == rows - 1 or k + COLUMNS >= len(charts):
            ranges.set(xlabel="part")
    return figure.svg()


def _draw_values(axes: Axes, chart: ControlChart, what: Characteristic, title: str) -> None:
    part = chart.order + 1
    _draw_line(axes, part, chart.value)
    axes.set(ylim=_span([*chart.value, *chart.limits]), title=title)
    _draw_tolerance(axes, what)
    for limit in (what.lower, what.upper):
        axes.axhline(limit, color=LIMIT, linewidth=1.0)
    if math.isfinite(chart.sigma):
        axes.axhline(chart.centre, color=GREY, linewidth=0.8)
        for limit in chart.limits:
            axes.axhline(limit, color=REJECTED, linewidth=0.8, dashes=(4, 2.5))
    at = sorted({k for k, rule in chart.signals if rule})
    axes.points(part[at], chart.value[at], "o", color=REJECTED, markersize=4, zorder=4)


def _draw_ranges(axes: Axes, chart: ControlChart) -> None:
    part = chart.order[1:] + 1
    _draw_line(axes, part, chart.moving_range)
    axes.set(ylim=(0, _span([0.0, *chart.moving_range, chart.range_limit])[1]))
    if math.isfinite(chart.range_limit):
        axes.axhline(chart.range_limit, color=REJECTED, linewidth=0.8, dashes=(4, 2.5))
    at = [k - 1 for k, rule in chart.signals if rule == 0]
    axes.points(part[at], chart.moving_range[at], "o", color=REJECTED, markersize=4, zorder=4)


def _draw_line(axes: Axes, part: Int, value: Float) -> None:
    axes.plot(part, value, color=MEASURED, linewidth=0.8, zorder=3)
    if len(part) <= WITH_DOTS:
        axes.points(part, value, "o", color=MEASURED, markersize=2.2, zorder=3)


def _draw_tolerance(axes: Axes, what: Characteristic) -> None:
    """The tolerance zone, as much of it as the axes show."""
    shown = axes.get_ylim()
    axes.axhspan(what.lower, what.upper, color=TOLERANCE, zorder=0)
    axes.set(ylim=shown)


def _span(values: Sequence[float]) -> tuple[float, float]:
    """Room for all of the finite values."""
    known = [v for v in values if math.isfinite(v)] or [0.0, 1.0]
    room = 0.12 * round(max(known) - min(known), 9) or 0.5
    return min(known) - room, max(known) + room


def trend_chart(studies: Sequence[Study]) -> bytes:
    """SVG: the mean over each part's sections, the lowest and the highest, and the straight line through the means."""
    figure = Figure(figsize=(WIDE_IN, 2.4 * len(studies)))
    rows = figure.subplots(len(studies), 1, sharex=True)
    for axes, one in zip(rows, studies, strict=True):
        what, fit = one.what, one.whole
        known = np.flatnonzero(np.isfinite(what.value).any(axis=1))
        inside = what.value[known]
        mean = np.nanmean(inside, axis=1)
        axes.fill_between(known + 1, np.nanmin(inside, axis=1), np.nanmax(inside, axis=1), color=MEASURED, alpha=0.2)
        _draw_line(axes, known + 1, mean)
        if math.isfinite(fit.slope):
            axes.plot(known + 1, mean.mean() + fit.slope * (known - known.mean()), color=INK, linewidth=1.2)
        _draw_tolerance(axes, what)
        axes.set(ylabel=f"{what.name}, {what.unit}")
        axes.integer = "x"
    rows[-1].set(xlabel="part, in the order given")
    return figure.svg()


def part_means(what: Characteristic) -> Float:
    """(P,) mean over the sections measured; NaN where there are none."""
    known = np.isfinite(what.value)
    count = known.sum(axis=1)
    total = np.where(known, what.value, 0.0).sum(axis=1)
    return np.where(count, total / np.maximum(count, 1), np.nan)


def worst_chart(found: Sequence[Characteristic], counts: Int) -> bytes:
    """SVG: in how many parts each section has the smallest margin; counts (characteristics, sections)."""
    figure = Figure(figsize=(WIDE_IN, 2.3))
    axes = figure.add_axes((0.07, 0.2, 0.92, 0.66))
    sections, base = range(1, counts.shape[1] + 1), np.zeros(counts.shape[1])
    for what, colour, count in zip(found, itertools.cycle(COLOURS), counts, strict=False):
        axes.plot([], [], color=colour, label=what.name)
        for x, low, high in zip(sections, base, base + count, strict=True):
            axes.fill([x - 0.35, x + 0.35, x + 0.35, x - 0.35], [low, low, high, high], facecolor=colour)
        base = base + count
    axes.axhline(counts.sum() / counts.shape[1], color=INK, linewidth=1.0, dashes=(4, 2.5))
    names = [f"{section}" for section in sections]
    axes.set(xticks=(sections, names), ylim=(0, None), xlabel="section", ylabel="parts in which\nit is the worst")
    axes.legend()
    return figure.svg()


LIMITS = ("lower", "upper")
PART_COLUMNS = ("part", "part_id", "recording", "outcome", "cause", "verdict", "seconds")
IDENTITY_COLUMNS = ("drawing", "operator", "recorded_at", "sensor", "sensor_serial", "robot", "robot_serial")


class Characteristic(NamedTuple):
    """One measured quantity: P parts in the order given, S sections; NaN where it was not measured."""

    name: str
    unit: str
    value: Shaped[Float, "P S"]
    u: Shaped[Float, "P S"]  # standard uncertainty
    lower: float  # limits of tolerance
    upper: float

    @property
    def margin(self) -> Float:
        """(P, S) distance to the nearer limit in shares of half the tolerance: 1 in the middle, below 0 outside."""
        return np.minimum(self.value - self.lower, self.upper - self.value) / ((self.upper - self.lower) / 2)


def worst_first(records: Sequence[Record]) -> list[Record]:
    """By outcome, then verdict, then the smallest margin."""
    found = characteristics(records)
    margin = least_margin(found)[0] if found else np.full(len(records), np.nan)

    def badness(i: int) -> tuple[int, int, float, int]:
        one = records[i]
        verdict = VERDICTS.index(one.verdict) if one.verdict in VERDICTS else len(VERDICTS)
        return OUTCOMES.index(one.outcome), verdict, float(np.nan_to_num(margin[i], nan=np.inf)), i

    return [records[i] for i in sorted(range(len(records)), key=badness)]


def characteristics(records: Sequence[Record]) -> tuple[Characteristic, ...]:
    """What is required of all parts; none where nothing was inspected, or not all to the same requirements."""
    inspected = [record for record in records if record.sections]
    if not inspected or any(one.requirements != inspected[0].requirements for one in inspected):
        return ()
    return tuple(
        Characteristic(
            ALL_TERMS[size][0].lower(),
            "°" if size.endswith("_deg") else "mm",
            _table(records, size),
            _table(records, u_name(size)),
            nominal + lower,
            nominal + upper,
        )
        for size, (nominal, (lower, upper)) in required_in_file(inspected[0].requirements).items()
    )


def _table(records: Sequence[Record], key: str) -> Float:
    sections = max(one["index"] for record in records for one in record.sections)
    table = np.full((len(records), sections), math.nan)
    for i, record in enumerate(records):
        for one in record.sections:
            if one.get(key) is not None:
                table[i, one["index"] - 1] = one[key]
    return table


def least_margin(found: Sequence[Characteristic]) -> tuple[Float, Int]:
    """(P,) smallest margin of each part over sections and characteristics, and its section from 0; NaN and -1: none."""
    margin = np.min([np.where(np.isnan(one.margin), np.inf, one.margin) for one in found], axis=0)
    section = np.argmin(margin, axis=1)
    least = margin[np.arange(len(margin)), section]
    measured = np.isfinite(least)
    return np.where(measured, least, np.nan), np.where(measured, section, -1)


def parquet(records: Sequence[Record]) -> bytes:
    """`fleet.parquet`: one row per part and section; one row without a section for a part that has none."""
    pa, pq = Extra("pyarrow"), Extra("pyarrow.parquet")
    required = [required_in_file(record.requirements) for record in records]
    every = [one for record, wanted in zip(records, required, strict=True) for one in (*record.sections, wanted)]
    there = {name for one in every for name in one}
    sizes = [name for name in ALL_TERMS if name in there] or [*BEVEL_TERMS]
    values = ["arc_length_mm", *(column for size in sizes for column in (size, u_name(size)))]
    text, number, whole = pa.string(), pa.float64(), pa.int32()
    types = {
        "order": whole,
        **dict.fromkeys(PART_COLUMNS, text),
        "seconds": number,
        **dict.fromkeys(IDENTITY_COLUMNS, text),
        "simulated": pa.bool_(),
        **dict.fromkeys((named(size, end) for end in LIMITS for size in sizes), number),
        "section": whole,
        **dict.fromkeys(values, number),
        "section_verdict": text,
    }
    rows = []
    for order, (record, wanted) in enumerate(zip(records, required, strict=True), 1):
        of_part = {"order": order, **record.identity, **{name: getattr(record, name) for name in PART_COLUMNS}}
        for size, (nominal, ends) in wanted.items():
            of_part |= {named(size, end): nominal + off for end, off in zip(LIMITS, ends, strict=True)}
        for one in record.sections or ({},):
            verdict = {"section": one.get("index"), "section_verdict": one.get("verdict")}
            rows.append(of_part | {name: one.get(name) for name in values} | verdict)
    for row in rows:  # a file's name need not be text that can be encoded
        row |= {name: row[name] and one_line(str(row[name])) for name in types if types[name] is text and name in row}
    out = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema=pa.schema(types)), out, compression="zstd")
    return out.getvalue()
