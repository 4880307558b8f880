"""The statements of docs/calibration.md: each function measures one and yields its table; the paper's Fig. 5, drawn."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bench.calibration import arm, faces, tools
from bench.calibration.paper import (
    CENTER_MM,
    TRUE,
    Measured,
    analytic,
    genetic,
    measured,
    sphere_centres,
    vol_mm,
)
from bench.tables import markdown
from workbench.geometry.poses import rotation_from_vector, vector_from_rotation
from workbench.pieces import styled, svg
from workbench.plugins.calibration.methods import Centres
from workbench.report.marks import FACES, GREY, MEASURED
from workbench.units import DEG, Float

BOXES_DEG = (1.0, 2.0, 5.0, 20.0)


def table1(trials: int) -> Iterator[str]:
    """Spread of the sphere centres by both ways, and the true error of the hand-eye pose."""
    rows = []
    for moved, words in ((False, "three postures, three times each"), (True, "three orientations, three places each")):
        sets = [measured(np.random.default_rng(seed), moved) for seed in range(trials)]
        ways = {"analytic": [analytic(m.centres) for m in sets]}
        for box in BOXES_DEG:
            ways[f"GA, box {box:g} deg"] = [
                genetic(m.centres, m.design, box, np.random.default_rng(seed)) for seed, m in enumerate(sets)
            ]
        plain = np.array([_spread(pose, m.centres) for pose, m in zip(ways["analytic"], sets, strict=True)])
        for name, poses in ways.items():
            spread = np.array([_spread(pose, m.centres) for pose, m in zip(poses, sets, strict=True)])
            gain = np.median(np.linalg.norm(plain, axis=1) / np.linalg.norm(spread, axis=1))
            rows.append(
                [
                    words,
                    name,
                    ", ".join(f"{v:.3f}" for v in np.median(spread, axis=0)),
                    f"{gain:.1f}",
                    f"{np.median([vol_mm(pose) for pose in poses]):.2f}",
                ]
            )
    yield from markdown(
        [
            "measurements",
            "method",
            "spread of the centres x, y, z, mm",
            "analytic spread over this",
            "true error over the field, mm",
        ],
        rows,
    )


def _spread(pose: Float, seen: Centres) -> Float:
    return np.asarray(sphere_centres(pose, seen).std(axis=0))  # with n, as the paper's


def equations(trials: int) -> Iterator[str]:
    """Equations (6) and (8) as printed, on exact measurements whose orientations are nearly or not at all alike."""
    found = []
    for spread_deg in (0.0, 0.1, 0.5, 2.0):
        off = [_printed_rotation(np.random.default_rng(seed), spread_deg) for seed in range(trials)]
        found.append([f"(6), all pairs, orientations within {spread_deg:g} deg", f"{np.median(off):.2f} deg"])
    shifts = [_printed_translation(np.random.default_rng(seed)) for seed in range(trials)]
    low, high = np.percentile(shifts, [5, 95])
    found.append(["(8) with its leading r_e^c", f"{low:.0f} to {high:.0f} mm"])
    yield from markdown(["as printed", "error (median; 5th to 95th percentile)"], found)


def _exact(rng: np.random.Generator, spread_deg: float) -> Centres:
    P = np.stack([rng.uniform(-10, 10, 9), rng.uniform(-4, 4, 9), rng.uniform(-15, 15, 9)], axis=1)
    r = rotation_from_vector(rng.normal(0, spread_deg * DEG, (9, 3)))
    return Centres(P, r, CENTER_MM - (r @ (P @ TRUE[:3, :3].T + TRUE[:3, 3])[..., None])[..., 0])


def _printed_rotation(rng: np.random.Generator, spread_deg: float) -> float:
    """Error in deg of the rotation that minimises (6) as printed: Kabsch over all pairs."""
    seen = _exact(rng, spread_deg)
    i, j = np.triu_indices(9, 1)
    moved = np.einsum("kji,kj->ki", seen.r[i], seen.t[j] - seen.t[i])
    U, _, V = np.linalg.svd(moved.T @ (seen.P[i] - seen.P[j]))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return float(np.linalg.norm(vector_from_rotation(R @ TRUE[:3, :3].T)) / DEG)


def _printed_translation(rng: np.random.Generator) -> float:
    """Error in mm of the translation that (8) gives as printed, with the true rotation and spread orientations."""
    seen, R = _exact(rng, 25.0), TRUE[:3, :3]
    i, j = np.triu_indices(9, 1)
    turned = (seen.r @ (seen.P @ R.T)[..., None])[..., 0] + seen.t
    matrix = R @ (seen.r[j] - seen.r[i])
    t = np.linalg.lstsq(matrix.reshape(-1, 3), (turned[i] - turned[j]).ravel(), rcond=None)[0]
    return float(np.linalg.norm(t - TRUE[:3, 3]))


STATEMENTS = {
    "table1": table1,
    "equations": equations,
    "arm": arm.statement,
    "tools": tools.statement,
    "faces": faces.statement,
}


BOX_DEG = 5.0
SEED = 3
COLOURS = (MEASURED, FACES[1], "#009e73")  # of the three orientations


def write_figure(path: Path) -> None:
    """Two rows, three postures repeated and three places an orientation; two columns, analytic and GA."""
    with styled():
        figure = Figure(figsize=(9, 7.6), layout="constrained")
        grid = figure.subplots(2, 2, subplot_kw={"projection": "3d"})
        for row, moved in zip(grid, (False, True), strict=True):
            sets = measured(np.random.default_rng(SEED), moved)
            ways = {
                "analytic": analytic(sets.centres),
                f"GA, box {BOX_DEG:g} deg": genetic(sets.centres, sets.design, BOX_DEG, np.random.default_rng(SEED)),
            }
            for axes, (name, pose) in zip(row, ways.items(), strict=True):
                title = "three orientations, three places each" if moved else "three postures, three times each"
                _draw(axes, sphere_centres(pose, sets.centres), sets, f"{title}: {name}")
        path.write_bytes(svg(figure))


def _draw(axes: object, centre: Float, sets: Measured, title: str) -> None:
    assert hasattr(axes, "scatter")
    off = centre - centre.mean(axis=0)
    for which, colour in enumerate(COLOURS):
        here = off[sets.orientation == which]
        axes.scatter(*here.T, color=colour, s=18, depthshade=False)
    reach = 1.1 * max(float(np.abs(off).max()), 0.05)
    for name in "xyz":
        getattr(axes, f"set_{name}lim")(-reach, reach)
        getattr(axes, f"set_{name}label")(f"{name}, mm")
    spread = ", ".join(f"{v:.2f}" for v in centre.std(axis=0))
    axes.set_title(f"{title}\nspread {spread} mm", fontsize=9)
    axes.tick_params(labelsize=7, colors=GREY)
