"""`compare.study`: a gauge study out of many inspections."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts.parts import shared
from workbench.compare.measurements import measurements_of, plain_measurements, read_inspection
from workbench.compare.study_tables import (
    apart,
    balanced,
    limits_of,
    mean_of_seen,
    reference_of,
    refuse_copies,
    sections_of,
    table_of,
)
from workbench.compare.values import CHARACTERISTICS, Study
from workbench.errors import InputError
from workbench.stage import InputFile, stage

Limits = tuple[float, float]


@stage("compare.study")
def study(
    *,
    study: Annotated[
        InputFile | None, Field(description="CSV or JSON that lists the measurements (docs/comparison.md)")
    ] = None,
    inspections: Annotated[
        list[InputFile], Field(description="inspection.json files: repeats of one part by one operator")
    ] = [],  # noqa: B006  (checked and copied before the function sees it)
    reference_operator: Annotated[
        str, Field(min_length=1, description="who stands for the reference in the study: the better measurement")
    ] = "reference",
    root_limits_mm: Annotated[
        Limits | None, Field(description="lower and upper limit of the root face; null: the inspections' own")
    ] = None,
    bevel_limits_deg: Annotated[
        Limits | None, Field(description="lower and upper limit of the bevel angle; null: the inspections' own")
    ] = None,
    characteristics: Annotated[
        list[str], Field(max_length=100, description="columns of the study to analyse, whatever they measure")
    ] = [],  # noqa: B006
    columns: Annotated[
        dict[Literal["part", "operator", "trial"], str],
        Field(
            description="what the study calls its columns `part`, `operator` and `trial`, where it is other people's"
        ),
    ] = {},  # noqa: B006
    limits: Annotated[
        dict[str, Limits], Field(description="lower and upper limit of each of the characteristics, where known")
    ] = {},  # noqa: B006
    unit: Annotated[
        str, Field(min_length=1, max_length=12, description="of characteristics whose names end in no unit")
    ] = "mm",
) -> Study:
    """Gather the measurements of a gauge study: parts x operators x trials, by section.

    Every part is measured by every operator equally often: an analysis of variance of unbalanced data has no single
    answer, so such a study is refused with the cell that differs. Measurements by `reference_operator` are not part of
    the study; their mean is what it is compared with.

    Args:
        study: lists inspections (`part,operator,inspection`) or values (`part,operator,trial,section,root_mm,...`).
        inspections: instead of it: files of one part, by one operator.
        reference_operator: the name under which the file lists reference measurements.
        root_limits_mm: tolerance limits, for the share of the tolerance.
        bevel_limits_deg: likewise.
        characteristics: columns of a CSV that hold one value a trial: any gauge, any size.
        columns: names of its other columns.
        limits: of the characteristics.
        unit: of the characteristics.

    Raises:
        InputError: unreadable, unbalanced, fewer than two trials, or trials that are copies.

    Example:
        >>> from workbench import compare
        >>> study = compare.study(study="data/synthetic/gauge_study.csv")
        >>> study.unit
        'mm'
    """
    if (study is None) == (not inspections):
        raise InputError("compare.study", "expected either a study or a list of inspections")
    if characteristics and study is None:
        raise InputError("compare.study", "expected a study, whose columns the characteristics are")
    if unknown := [name for name in limits if name not in characteristics]:
        raise InputError("compare.study.limits", f"'{unknown[0]}' is not one of the characteristics")
    if study is not None and characteristics:
        found = plain_measurements(study, characteristics, {str(key): name for key, name in columns.items()})
    else:
        found = measurements_of(study) if study is not None else [read_inspection(path) for path in inspections]
    where = str(study) if study is not None else "inspections"
    mine = [one for one in found if one.operator != reference_operator]
    others = [one for one in found if one.operator == reference_operator]
    cells = balanced(mine, where)
    parts, operators = list(dict.fromkeys(p for p, _ in cells)), list(dict.fromkeys(o for _, o in cells))
    sections = sections_of(mine)
    known = dict.fromkeys(characteristics, "") or CHARACTERISTICS
    table = {
        name: table_of(cells, parts, operators, sections, name) for name in ("arc_length_mm", *known, *known.values())
    }
    names = [name for name in known if np.isfinite(table[name]).any()]
    if not names:
        raise InputError(where, f"expected values of {' or '.join(known)}, found none")
    refuse_copies({name: table[name] for name in names}, parts, operators, where)
    reference = reference_of(others, parts, sections, names)
    given: dict[str, Limits | None] = {"root_mm": root_limits_mm, "bevel_deg": bevel_limits_deg, **limits}
    return Study(
        parts=tuple(parts),
        operators=tuple(operators),
        trials=len(next(iter(cells.values()))),
        section=sections,
        arc_length_mm=mean_of_seen(table["arc_length_mm"], (0, 1, 2)),
        measured={name: table[name] for name in names},
        stated_u={name: table[known[name]] for name in names},
        reference={name: value for name, (value, _) in reference.items()},
        reference_u={name: u for name, (_, u) in reference.items()},
        limits={name: held for name in names if (held := limits_of(given.get(name), mine, name, where)) is not None},
        unit=unit,
        files=tuple((one.where, one.digest) for one in found if one.digest),
        part=shared([one.identity for one in found]),
        warnings=apart(table["arc_length_mm"]),
    )
