"""`python -m bench.score.laws`: does u follow information, and do the values stay when only the telling changes?"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from bench.harness import ROOT, made_by
from bench.open.rivals import rival
from bench.recordings import columns, dense_stream, frames, told, with_values
from bench.score import triangulated
from bench.score.parts import Drawn
from bench.score.table import put
from bench.tables import markdown
from workbench.artefacts import Recording
from workbench.errors import WorkbenchError
from workbench.scan import read, write
from workbench.scan.fuse import flange_poses
from workbench.units import Float

ENGINE = "WORKBENCH_SCORED_ENGINE"  # environment: another engine for the same laws
GROWS = 1.1  # by which u may grow with more information
ROUNDING = {"root_mm": 1e-4, "bevel_deg": 1e-3}  # float32 ranges, and orders of sums
ROUNDING_OF_U = 0.01  # of u
SHIPPED = ("milled_edge", "milled_arc", "milled_two_pass")
DRAWN = {"sharp": (1, 2, 3), "worn": (1, 2, 4)}
Change = Callable[[Recording], Recording]


def noisier(r: Recording) -> Recording:
    noise = np.random.default_rng(7).normal(0.0, 0.02, r.z_mm.shape)
    return with_values(r, z_mm=(r.z_mm + noise).astype(np.float32))


POORER: dict[str, Change] = {
    "every second frame": lambda r: frames(r, np.arange(0, len(r.time_s), 2)),
    "every second column": lambda r: columns(r, slice(None, None, 2)),
    "0.02 mm more noise": noisier,
    "the first pass alone": lambda r: frames(r, r.pass_index == r.pass_index[0]),
    "the last pass alone": lambda r: frames(r, r.pass_index == r.pass_index[-1]),
}


SHIFT_MM = np.array([300.0, -200.0, 50.0])
TURN = Rotation.from_rotvec([0.0, 0.0, 1.27]).as_matrix()


def moved(r: Recording) -> Recording:
    """The robot's base elsewhere, and turned by 73 deg."""
    poses = flange_poses(r)
    return told(r, poses[:, :3, 3] @ TURN.T + SHIFT_MM, TURN @ poses[:, :3, :3])


def mirrored(r: Recording) -> Recording:
    """All of it in a mirror: x of sensor, flange and base."""
    poses, m = flange_poses(r), np.diag([-1.0, 1.0, 1.0, 1.0])
    place, turn = poses[:, :3, 3] * [-1.0, 1.0, 1.0], m[:3, :3] @ poses[:, :3, :3] @ m[:3, :3]
    return told(r, place, turn, x_mm=-r.x_mm, flange_from_profiler=m @ r.flange_from_profiler @ m)


def backwards(r: Recording) -> Recording:
    """The scan run the other way: frames and passes in the opposite order."""
    poses, last = flange_poses(r)[::-1], r.time_s[-1] + r.time_s[0]
    turned = frames(r, np.arange(len(r.time_s))[::-1])
    turned = with_values(turned, time_s=last - turned.time_s, pass_index=r.pass_index.max() - turned.pass_index)
    return told(turned, poses[:, :3, 3], poses[:, :3, :3])


ALIKE: dict[str, Change] = {
    "the base moved and turned": moved,
    "in a mirror": mirrored,
    "run backwards": backwards,
    "columns in the other order": lambda r: columns(r, slice(None, None, -1)),
}


@cache
def drawn(name: str) -> Drawn:
    """A recording and what is declared of it, by the name that `names` gives it."""
    if name in SHIPPED:
        declared = {"kind": "milled", "root_nominal_mm": 1.5, "bevel_nominal_deg": 40.0}
        return Drawn(read(recording=ROOT / "data" / "synthetic" / f"{name}.h5"), {}, declared, name)
    group, _, seed = name.partition(" ")
    found = triangulated.DRAWS[group](int(seed))
    return found._replace(
        declared={**found.declared, "edge_condition": "sharp"} if group == "sharp" else found.declared
    )


def names() -> list[str]:
    return [*SHIPPED, *(f"{group} {seed}" for group, seeds in DRAWN.items() for seed in seeds)]


@cache
def measured(name: str, change: str) -> Mapping[str, Float]:
    """Sections of a recording, as it is ('') or changed; refused: a WorkbenchError."""
    part = drawn(name)
    changed = {"": lambda r: r, "as told": dense_stream, **POORER, **ALIKE}[change](part.recording)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "part.h5")
        write(changed, path)
        found = rival(os.environ.get(ENGINE, "product")).measure(path, part.declared)["sections"]
        names = ("root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg")
        return {name: np.array([section[name] for section in found], float) for name in names}


def growth(name: str, change: str, quantity: str) -> float:
    """u of the recording over that of the poorer one, medians over the sections; refused: its u is infinite."""
    u = []
    head, unit = quantity.split("_")
    for one in ("", change):
        try:
            u.append(float(np.nanmedian(measured(name, one)[f"{head}_u_{unit}"])))
        except WorkbenchError:
            u.append(np.inf)
    return 0.0 if np.isinf(u[1]) else u[0] / u[1]


def change_of(name: str, change: str, quantity: str) -> tuple[float, float]:
    """Greatest change of a section's value, and of its u over u; infinite where one of both is refused."""
    head, unit = quantity.split("_")
    try:
        one, other = measured(name, "as told"), measured(name, change)
    except WorkbenchError:
        return np.inf, np.inf
    u = np.asarray(one[f"{head}_u_{unit}"])
    best = []
    for turn in (1, -1):  # sections count from either end
        value = np.abs(np.asarray(other[quantity])[::turn] - one[quantity])
        both = np.abs(np.asarray(other[f"{head}_u_{unit}"])[::turn] / u - 1.0)
        best.append((float(np.nanmax(value)), float(np.nanmax(both))))
    return min(best)


def applies(name: str, change: str) -> bool:
    """Whether there is what the change takes away."""
    return "pass" not in change or len(np.unique(drawn(name).recording.pass_index)) > 1


def table() -> str:
    """Every law over all recordings: by how much it fails at most, and where."""
    rows = []
    for change in POORER:
        mine = [name for name in names() if applies(name, change)]
        for quantity in ROUNDING:
            found = {name: growth(name, change, quantity) for name in mine}
            worst = max(found, key=found.__getitem__, default="none")
            held = f"{sum(g <= GROWS for g in found.values())} of {len(mine)}"
            rows.append([change, f"`{quantity}`", held, f"u {found.get(worst, 0.0):.2f} times", worst])
    for change in ALIKE:
        for quantity, limit in ROUNDING.items():
            both = {name: change_of(name, change, quantity) for name in names()}
            worst = max(both, key=both.__getitem__)
            value, u = both[worst][0], max(one[1] for one in both.values())
            held = f"{sum(v <= limit and du <= ROUNDING_OF_U for v, du in both.values())} of {len(both)}"
            rows.append([change, f"`{quantity}`", held, f"{value:.5f}, u {100 * u:.1f} %", worst])
    return "\n".join(markdown(["against", "value", "held", "worst", "of"], rows))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.score.laws", description=__doc__)
    parser.add_argument("--docs", action="store_true", help="write the table into docs/score.md")
    given = parser.parse_args()
    text = f"`python -m bench.score.laws`{made_by() if given.docs else ''}\n\n### Laws\n\n{table()}"
    print(text)
    if given.docs:
        put(text, "laws")
    return 0


if __name__ == "__main__":
    sys.exit(main())
