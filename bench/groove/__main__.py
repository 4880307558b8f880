"""`python -m bench.groove`: refusals, wrong types and errors of every size of drawn grooves and prepared plates.

Grooves: `swept` and `odd` of the swept simulator, `prism` of the package's, `shop_floor` of the third one
(`bench.odd_grooves`), whose type is not asked for. Plates: `plate` and `odd_plate` of the swept simulator,
`outside_plate` and `x_plate` of the third one.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from bench.drawn import grooves, preparations
from bench.harness import each, made_by
from bench.odd_grooves import SHAPES, exact, odd_groove, swapped
from bench.simulators.swept import SweptRecipe, simulate_groove, simulate_swept
from bench.simulators.swept.sweep import GROOVES
from bench.tables import markdown
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
    sizes = partial(_as_read, dict(truth.preparation), kind, recipe.part.middle_radius_mm)
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
    "odd": (GROOVES, lambda kind, seed: of_groove(kind, simulate_groove(grooves.odd_groove(kind, seed)))),
    "prism": (GROOVES, lambda kind, seed: of_groove(kind, simulate_prism(grooves.random_prism_recipe(kind, seed)))),
    "shop_floor": (tuple(SHAPES), shop_floor),
    "plate": (PLATES, lambda kind, seed: of_recipe(kind, preparations.swept_plate(kind, seed))),
    "odd_plate": (PLATES, lambda kind, seed: of_recipe(kind, preparations.odd_plate(kind, seed))),
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


class Outcome(NamedTuple):
    """Of one joint."""

    name: str
    kind: str
    refused: str  # by which words
    taken: str  # for which type that it is not
    rows: Rows

    @property
    def word(self) -> str:
        if self.refused or self.taken:
            return "refused" if self.refused else "another type"
        return "beyond 3 u" if self.far else "right"

    @property
    def far(self) -> dict[str, float]:
        """Greatest error over u of the sizes beyond FAR."""
        over = [(size, abs(error) / u) for size, error, u in self.rows if abs(error) > FAR * u]
        return {size: max(z for name, z in over if name == size) for size, _ in over}


def judged(task: tuple[str, str, int]) -> Outcome:
    """Draw and measure a joint."""
    name, kind, seed = task
    told = f"{name} {kind} {seed}"
    try:
        joint = JOINTS[name][1](kind, seed)
        found, rows = measured(joint)
    except WorkbenchError as error:
        return Outcome(told, f"{name} {kind}", str(error), "", [])
    known = not joint.types or {found.type, *getattr(found, "alternatives", ())} & set(joint.types)
    return Outcome(told, f"{name} {kind}", "", "" if known else found.type, rows)


def tables(found: Sequence[Outcome]) -> list[str]:
    """How the joints of each kind ended, errors and standard uncertainties of each size, in mm or deg, and the far."""
    words = ("right", "refused", "another type", "beyond 3 u")
    ended = Counter((one.kind, one.word) for one in found)
    kinds = dict.fromkeys(one.kind for one in found)
    ends = markdown(["joint", *words], ([kind, *(str(ended[kind, word]) for word in words)] for kind in kinds))
    rows = []
    for size in dict.fromkeys(size for one in found if not one.taken for size, _, _ in one.rows):
        error, u = np.array([row[1:] for one in found if not one.taken for row in one.rows if row[0] == size]).T
        z = np.abs(error) / u
        shown = [f"{value:.3f}" for value in (np.median(error), np.quantile(np.abs(error), 0.95), np.median(u))]
        rows.append([f"`{size}`", str(z.size), *shown, f"{100 * np.mean(z <= 2):.1f}", f"{100 * np.mean(z > FAR):.1f}"])
    head = ["size", "values", "median error", "p95 error", "median u", "within 2 u, %", "beyond 3 u, %"]
    far = [f"- {o.name}: {', '.join(f'{s} {z:.1f} u' for s, z in o.far.items())}" for o in found if o.word == words[3]]
    taken = [f"- {one.name}: taken for {one.taken}" for one in found if one.taken]
    return [*ends, "", *markdown(head, rows), "", *far, *taken]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.groove", description=__doc__)
    parser.add_argument("--joints", nargs="+", choices=JOINTS, default=list(JOINTS))
    parser.add_argument("--kinds", nargs="+", help="of them")
    parser.add_argument("--parts", type=int, default=20, help="a kind")
    parser.add_argument("--seed", type=int, default=0, help="of the first part")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    given = parser.parse_args()
    tasks = [
        (name, kind, seed)
        for seed in range(given.seed, given.seed + given.parts)
        for name in given.joints
        for kind in JOINTS[name][0]
        if not given.kinds or kind in given.kinds
    ]
    found = sorted(each(judged, tasks, given.workers, "joints"))
    told = f"python -m bench.groove --joints {' '.join(given.joints)} --parts {given.parts} --seed {given.seed}"
    kinds = f" --kinds {' '.join(given.kinds)}" if given.kinds else ""
    print("\n".join([f"`{told}{kinds}`{made_by()}", "", *tables(found)]))


def _as_read(exact: dict[str, Float], kind: str, foot_radius_mm: float, found: str) -> dict[str, Float]:
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
    radius = exact.get("root_radius_mm", np.full(len(exact["land_mm"]), foot_radius_mm))
    reach = radius * np.tan((90.0 - exact["bevel_deg"]) * DEG / 2)
    sharp = exact["land_mm"] + (reach if kind == "J" else -reach)
    return exact | {"land_mm": sharp} | ({"root_radius_mm": radius} if found == "J" else {})


if __name__ == "__main__":
    main()
