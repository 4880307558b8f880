"""`inspect.groove`, `inspect.preparation`, `inspect.groove_gate`: a joint's sizes in sections, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from workbench.artefacts import (
    Gate,
    Groove,
    GrooveInspection,
    Preparation,
    PreparationInspection,
    Quantity,
    Section,
    Unseen,
)
from workbench.artefacts.edges import MOST_OFF, PREPARATION_TERMS, TERMS, Joint, RecognisedInspection, named
from workbench.artefacts.evidence import CUT_AWAY_MM, SCALE
from workbench.errors import InputError, nearest
from workbench.inspect.section import section_at
from workbench.inspect.verdict import NOTHING_REQUIRED, of_a_joint, of_the_part
from workbench.stage import stage
from workbench.units import DEG, Float

LEFT_OUT = (
    Unseen(
        "other_side",
        "What the side that was scanned does not show: root faces that look away from the sensor, bevels below the "
        "root.",
    ),
    Unseen(
        "cover", "What covers all that is seen of a plate's upper surface, as tape or a sheet: its top is measured."
    ),
)
LEFT_OUT_OF_PLATES = (
    Unseen("other_side", "What the side that was scanned does not show: bevels below the root face."),
)


def _required(nominal: Mapping[str, Any], terms: Mapping[str, Any]) -> dict[str, tuple[float, tuple[float, float]]]:
    """Nominal and tolerance by size; ValueError where a name is none of `terms`, or a number or a pair is missing."""
    tolerances = {named(size, "tolerance"): size for size in terms}
    for name in nominal:
        if name not in terms and name not in tolerances:
            raise ValueError(f"{name}: no size of such a joint{nearest(name, [*terms, *tolerances])}")
        if name in tolerances and tolerances[name] not in nominal:
            raise ValueError(f"{name}: expected '{tolerances[name]}' beside it")
    found = {}
    for size in terms:
        if size not in nominal:
            continue
        key = named(size, "tolerance")
        if not _number(nominal[size]):
            raise ValueError(f"{size}: expected a number")
        if nominal[size] < 0 and size != "misalignment_mm":
            raise ValueError(f"{size}: expected 0 or more, found {nominal[size]:g}")
        pair = nominal.get(key)
        two = isinstance(pair, list | tuple) and len(pair) == 2 and all(map(_number, pair))
        if pair is None or not two or not -MOST_OFF <= pair[0] <= 0 <= pair[1] <= MOST_OFF:
            raise ValueError(
                f"{key}: expected deviations of at most {MOST_OFF:g}, [lower, upper] with lower <= 0 <= upper"
            )
        found[size] = (float(nominal[size]), (float(pair[0]), float(pair[1])))
    return found


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _of(terms: Mapping[str, Any]) -> AfterValidator:
    """Nominal sizes are checked with all other parameters, before anything runs."""

    def checked(nominal: dict[str, Any] | None) -> dict[str, Any] | None:
        _required(nominal or {}, terms)
        return nominal

    return AfterValidator(checked)


@stage("inspect.groove")
def groove(
    groove: Groove,
    *,
    nominal: Annotated[dict[str, Any] | None, _of(TERMS)] = None,
    sections: Annotated[int, Field(ge=1, le=999)] = 9,
    guard_factor: Annotated[float, Field(ge=0, le=5)] = 1.645,
    accept_conditions: tuple[Literal["window_end", "knife_edge"], ...] = (),
) -> GrooveInspection:
    """Measure a groove in equidistant sections and judge what is required.

    Sections and verdicts as in `inspect.sections`; a size not seen, or nothing required, is undecided.

    Args:
        groove: the measured groove.
        nominal: required sizes by their names in groove.json, with tolerances: {'gap_mm': 2, 'gap_tolerance_mm': [-0.5,
            0.5]}; null: nothing is judged.
        sections: count of sections along the groove.
        guard_factor: guard band over u; 1.645: 95 % one-sided.
        accept_conditions: as in `inspect.sections`.

    Raises:
        PipelineError: a name that no groove has, or a nominal without its tolerance, before anything is measured.

    Example:
        >>> from workbench import edge, inspect, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> found = inspect.groove(edge.segment_groove(points))
        >>> found.type, len(found.sections)
        ('Y', 9)
    """
    return GrooveInspection(**_judged(groove, nominal or {}, sections, guard_factor, LEFT_OUT, accept_conditions))


@stage("inspect.preparation")
def preparation(
    preparation: Preparation,
    *,
    nominal: Annotated[dict[str, Any] | None, _of(PREPARATION_TERMS)] = None,
    sections: Annotated[int, Field(ge=1, le=999)] = 9,
    guard_factor: Annotated[float, Field(ge=0, le=5)] = 1.645,
    accept_conditions: tuple[Literal["window_end"], ...] = (),
) -> PreparationInspection:
    """Measure the prepared edge of a plate in equidistant sections and judge, as `inspect.groove`.

    Args:
        preparation: the measured edge.
        nominal: as in `inspect.groove`, by their names in preparation.json.
        sections: count of sections along the edge.
        guard_factor: guard band over u; 1.645: 95 % one-sided.
        accept_conditions: as in `inspect.sections`.

    Raises:
        PipelineError: a name that no preparation has, or a nominal without its tolerance.

    Example:
        >>> from workbench import cloud, edge, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_nose.h5")))
        >>> found = inspect.preparation(edge.segment_preparation(points))
        >>> found.type, len(found.sections)
        ('nose', 9)
    """
    given = nominal or {}, sections, guard_factor, LEFT_OUT_OF_PLATES, accept_conditions
    return PreparationInspection(**_judged(preparation, *given))


def _judged(
    joint: Joint,
    nominal: Mapping[str, Any],
    sections: int,
    guard_factor: float,
    left_out: tuple[Unseen, ...],
    accepted: tuple[str, ...],
) -> dict[str, Any]:
    """The fields of a joint's inspection."""
    required = _required(nominal, joint.terms)
    at = (np.arange(sections) + 0.5) / sections * float(joint.arc_length_mm[-1])
    sizes = [joint.sizes[name].where(joint.seen) for name in joint.terms if name in joint.sizes]
    places = (
        section_at(i, float(s), joint, joint.origin_mm, sizes, required, joint.terms, guard_factor)
        for i, s in enumerate(at, 1)
    )
    inspected = tuple(
        replace(one, corners=tuple(corner for name in joint.corners if (corner := _corner(joint, name, one))))
        for one in places
    )
    if not any(np.isfinite(one.value) for s in inspected for one in s.sizes.values()):
        raise InputError(
            type(joint).__name__.lower(), f"none of {len(inspected)} sections could be measured: is this such a joint?"
        )
    verdict, reason, left, notes = of_the_part(inspected, joint.unseen, required, guard_factor, accepted)
    return {
        "type": joint.type,
        "alternatives": joint.alternatives,
        "declared": joint.declared,
        "sections": inspected,
        "requirements": dict(nominal),
        "guard_factor": guard_factor,
        "verdict": verdict,
        "reason": reason,
        "conditions": left,
        "uncertainty": of_a_joint(
            joint.part,
            *(one for one in joint.unseen if not one.is_doubt),
            *_unseen(joint.sizes),
            *left_out,
        ),
        "part": joint.part,
        "warnings": (*joint.warnings, *notes),
        "checks": joint.checks,
    }


def _unseen(sizes: Mapping[str, Quantity]) -> tuple[Unseen, ...]:
    """What its recording does not show of the sensor's scale, and of ends of bevels that return nothing."""
    about = {name: abs(float(np.nanmedian(one.value))) for name, one in sizes.items() if np.isfinite(one.value).any()}
    cost: dict[str, float] = {name: SCALE * about[name] for name in ("gap_mm", "depth_mm", "width_mm") if name in about}
    if "included_deg" in about:
        cost["included_deg"] = SCALE * math.sin(about["included_deg"] * DEG) / DEG
    bevels = [about[name] * DEG for name in ("bevel_left_deg", "bevel_right_deg") if name in about]
    found = (Unseen("scale", f"An error of {100 * SCALE:g} % of the profiler's scale.", cost),)
    if not bevels or "gap_mm" not in about:
        return found
    lost = {"gap_mm": sum(map(math.sin, bevels)), "depth_mm": max(map(math.cos, bevels))}
    sentence = f"All along a root, {CUT_AWAY_MM:g} mm of the bevel that return nothing, or a burr in its plane."
    return (*found, Unseen("lost_columns", sentence, {name: CUT_AWAY_MM * one for name, one in lost.items()}))


@stage("inspect.groove_gate")
def groove_gate(
    inspection: RecognisedInspection,
    *,
    accept_unjudged: bool = True,
) -> Gate:
    """Pass a groove on if its verdict is `pass`, or if nothing was required (with a warning).

    Args:
        inspection: the judged groove.
        accept_unjudged: pass a part without requirements.

    Example:
        >>> from workbench import edge, inspect, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> found = inspect.groove(edge.segment_groove(points))
        >>> inspect.groove_gate(found).passed
        True
    """
    if not inspection.requirements and accept_unjudged:
        return Gate(True, f"{inspection.verdict}: {inspection.reason}", warnings=(NOTHING_REQUIRED,))
    return Gate(inspection.verdict == "pass", f"{inspection.verdict}: {inspection.reason}")


def _corner(joint: Joint, name: str, section: Section) -> dict[str, Any] | None:
    corner, at = joint.corners[name], section.arc_length_mm
    there = np.where(joint.seen, np.hstack([corner.section_mm, corner.u_mm]).T, np.nan)
    a, b, *u = (float(np.interp(at, joint.arc_length_mm, one)) for one in there)
    if not np.isfinite([a, b, *u]).all():
        return None
    position = section.origin_mm + a * section.normal + b * section.across
    return {
        "name": name,
        "position_mm": position.tolist(),
        "u_mm": u,
        "section_mm": [a, b],
        "column": _column(joint, position, at),
    }


def _column(joint: Joint, position: Float, at: float) -> float | None:
    """Fractional column at which the nearest profile's x is that of a place; None: beyond its columns."""
    frame = int(np.nanargmin(np.abs(joint.frame_arc_length_mm - at)))
    pose = joint.base_from_profiler[frame]
    x = float((position - pose[:3, 3]) @ pose[:3, 0])
    columns = np.flatnonzero(np.isfinite(joint.x_mm[frame]))
    places = joint.x_mm[frame, columns].astype(np.float64)
    order = np.argsort(places, kind="stable")
    places, columns = places[order], columns[order]
    if not places.size or not places[0] <= x <= places[-1]:
        return None
    return float(np.interp(x, places, columns))
