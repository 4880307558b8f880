"""Grooves and prepared plates of four simulators: refusals, wrong types, errors beside u: `python -m bench.joints`.

Grooves: `swept` of the swept simulator, `prism` of the package's, `shop_floor` of the third one
(`bench.odd_grooves`), whose type is not asked for. Plates: `plate` of the swept simulator,
`outside_plate` and `x_plate` of the third one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from bench.drawn import grooves, preparations
from bench.harness import Option, Study
from bench.odd_grooves import SHAPES, exact, odd_groove, swapped
from bench.simulators.swept import SweptRecipe, simulate_groove, simulate_swept
from bench.simulators.swept.sweep import GROOVES
from bench.tables import folded, markdown
from workbench.artefacts import SIZES, GrooveInspection, PreparationInspection, Recording, u_name
from workbench.cloud import denoise
from workbench.edge import segment_groove, segment_preparation
from workbench.errors import WorkbenchError
from workbench.inspect import groove as inspect_groove
from workbench.inspect import preparation as inspect_preparation
from workbench.scan import fuse
from workbench.synthetic import GrooveTruth
from workbench.synthetic.prism_scan import simulate_prism
from workbench.units import DEG, Float

FAR = 3.0  # standard uncertainties: beyond, it is confidently wrong
BEYOND = f"beyond {FAR:g} u"
OUTCOMES = ("refused", "crashed", "another type", BEYOND)
Rows = list[tuple[str, float, float]]  # size, error, u: mm or deg
Exact = Callable[[str, Any], Mapping[str, float]]  # of the type found and a section, its true sizes


class Joint(NamedTuple):
    """A drawn joint."""

    recording: Recording
    exact: Exact
    types: tuple[str, ...] = ()  # as which it may be taken; none: any
    root_mm: float | None = None  # that the drawing of a plate says


def of_groove(kind: str, made: tuple[Recording, GrooveTruth]) -> Joint:
    return Joint(made[0], partial(groove_sizes, made[1]), (kind,))


def groove_sizes(truth: GrooveTruth, _: str, section: Any) -> dict[str, float]:
    at = int(np.argmin(np.linalg.norm(truth.position_mm - section.origin_mm, axis=1)))
    sizes = {name: float(np.asarray(getattr(truth.sizes, name))[at]) for name in SIZES}
    return swapped(sizes) if float(truth.normal[at] @ section.normal) < 0 else sizes


def shop_floor(shape: str, seed: int) -> Joint:
    part = odd_groove(shape, seed)
    return Joint(part.recording, partial(exact, part))


def of_recipe(kind: str, recipe: SweptRecipe) -> Joint:
    recording, truth = simulate_swept(recipe)
    sizes = partial(_as_read, dict(truth.preparation), kind)
    return _plate(kind, recording, sizes, truth.position_mm, truth.preparation)


def of_outside(kind: str, made: tuple[Recording, Mapping[str, Float]]) -> Joint:
    recording, sizes = made
    return _plate(kind, recording, lambda _: sizes, np.zeros((1, 3)), sizes)


def _plate(kind: str, recording: Recording, sizes: Any, position: Float, true: Mapping[str, Float]) -> Joint:
    def of_section(found: str, section: Any) -> dict[str, float]:
        at = int(np.argmin(np.linalg.norm(position - section.origin_mm, axis=1)))
        return {name: float(values[at]) for name, values in sizes(found).items()}

    types = ("nose", "J") if kind in ("nose", "J") else (kind,)
    return Joint(recording, of_section, types, max(0.5, round(2 * float(true["root_face_mm"].mean())) / 2))


PLATES = preparations.KINDS
JOINTS: dict[str, tuple[Sequence[str], Callable[[str, int], Joint]]] = {  # by name: kinds, draw
    "swept": (GROOVES, lambda kind, seed: of_groove(kind, simulate_groove(grooves.random_groove_recipe(kind, seed)))),
    "prism": (GROOVES, lambda kind, seed: of_groove(kind, simulate_prism(grooves.random_prism_recipe(kind, seed)))),
    "shop_floor": (tuple(SHAPES), shop_floor),
    "plate": (PLATES, lambda kind, seed: of_recipe(kind, preparations.swept_plate(kind, seed))),
    "outside_plate": (PLATES, lambda kind, seed: of_outside(kind, preparations.outside_plate(kind, seed))),
    "x_plate": (("bevel",), lambda kind, seed: of_outside(kind, preparations.x_plate(seed))),
}


def measured(joint: Joint) -> tuple[GrooveInspection | PreparationInspection, Rows]:
    """The joint inspected, and every value of every section beside its truth."""
    cloud = denoise(fuse(joint.recording))
    if joint.root_mm is None:
        found: Any = inspect_groove(segment_groove(cloud))
    else:
        found = inspect_preparation(segment_preparation(cloud, root_nominal_mm=joint.root_mm))
    return found, errors(found, joint.exact)


def errors(found: GrooveInspection | PreparationInspection, exact: Exact) -> Rows:
    """Size, error and u of every value of every section that has a truth."""
    rows = []
    for section in found.sections:
        for size, true in exact(found.type, section).items():
            value, u = section.values.get(size), section.values.get(u_name(size))
            if value is not None and u is not None and np.isfinite(true):
                rows.append((size, value - true, u))
    return rows


CONDITIONS = {
    f"{name}_{kind.replace(' ', '_')}": (draw, kind) for name, (kinds, draw) in JOINTS.items() for kind in kinds
}


def measure(task: tuple[str, int]) -> dict[str, Any]:
    """A joint of a condition and seed, every error over its u; or the field of OUTCOMES that says why it has none."""
    draw, kind = CONDITIONS[task[0]]
    row: dict[str, Any] = {"condition": task[0], "seed": task[1]}
    try:
        joint = draw(kind, task[1])
        found, rows = measured(joint)
    except WorkbenchError as error:
        return row | {"refused": str(error)}
    except Exception as error:  # a defect, to be counted and not to stop the study
        return row | {"crashed": repr(error)}
    if joint.types and not {found.type, *getattr(found, "alternatives", ())} & set(joint.types):
        return row | {"another type": f"taken for {found.type}"}
    z = [(size, abs(error) / u) for size, error, u in rows]
    far = {size: max(v for name, v in z if name == size) for size, v in z if v > FAR}
    said = {BEYOND: ", ".join(f"{size} {v:.1f} u" for size, v in far.items())} if far else {"right": True}
    return row | {"z": [v for _, v in z]} | said


def report(rows: Sequence[Mapping[str, Any]], _: Any) -> Iterator[str]:
    """How many of each simulator and condition end how, and the shares of their values; the first cause of each end."""
    head = ["parts", "right", *OUTCOMES, "values", "within 2 u, %", f"beyond {FAR:g} u, %"]
    conditions = {name: [row for row in rows if row["condition"] == name] for name in CONDITIONS}
    simulators = {name: [row for row in rows if row["condition"].startswith(f"{name}_")] for name in JOINTS}
    causes = [
        [name, outcome, str(len(such)), str(such[0]["seed"]), such[0][outcome]]
        for name, of in conditions.items()
        for outcome in OUTCOMES
        if (such := [row for row in of if outcome in row])
    ]
    for heading, groups in (("simulator", simulators), ("condition", conditions)):
        yield from (f"### Joints by {heading}", "")
        yield from (*markdown([heading, *head], [[name, *_ended(of)] for name, of in groups.items() if of]), "")
    yield from ("### First causes", "", *markdown(["condition", "outcome", "parts", "first seed", "its cause"], causes))


def _ended(of: Sequence[Mapping[str, Any]]) -> list[str]:
    """How many of these parts end how, and the shares of their values."""
    ended = [sum(outcome in row for row in of) for outcome in ("right", *OUTCOMES)]
    z = np.concatenate([[], *(row.get("z", []) for row in of)])
    shares = [f"{100 * np.mean(inside):.1f}" if z.size else "" for inside in (z <= 2.0, z > FAR)]
    return [*map(str, (len(of), *ended, z.size)), *shares]


def _as_read(exact: dict[str, Float], kind: str, found: str) -> dict[str, Float]:
    """Sizes of a nose whose corner is filled by the terms of a J, and the other way round; two bevels as one.

    The land of a nose counts to the corner that bevel and land would make, that of a J to where its fillet begins.
    """
    if (kind, found) == ("compound", "bevel"):
        upper = (exact["depth_mm"] - exact["lower_bevel_mm"]) / np.cos(exact["upper_bevel_deg"] * DEG)
        lower = exact["lower_bevel_mm"] / np.cos(exact["bevel_deg"] * DEG)
        bevel = (upper * exact["upper_bevel_deg"] + lower * exact["bevel_deg"]) / (upper + lower)
        return exact | {"bevel_deg": bevel}
    if {kind, found} != {"nose", "J"}:
        return exact
    radius = exact.get("root_radius_mm", np.zeros(len(exact["land_mm"])))
    reach = radius * np.tan((90.0 - exact["bevel_deg"]) * DEG / 2)
    sharp = exact["land_mm"] + (reach if kind == "J" else -reach)
    return exact | {"land_mm": sharp} | ({"root_radius_mm": radius} if found == "J" else {})


STUDY = Study(
    "joints",
    str(__doc__),
    {
        "parts": Option(20, "a condition"),
        "seed": Option(1_000_000, "of each condition's first part"),
        "conditions": Option(tuple(CONDITIONS), choices=CONDITIONS),
    },
    lambda given: [(name, given.seed + k) for name in given.conditions for k in range(given.parts)],
    measure,
    report,
    "grooves.md",
    "joints",
    partial(folded, largest=900),
)
if __name__ == "__main__":
    STUDY()
