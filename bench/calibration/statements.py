"""The statements of docs/calibration.md: each function measures one and yields its table; the paper's Fig. 5, drawn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
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
    turn_cost,
    vol_mm,
)
from bench.drawn.spheres import random_sphere_recipe
from bench.metrology.calibration.truth import bound, cell_of, circles
from bench.speed.calibration import with_signs
from bench.tables import markdown
from workbench.geometry.poses import pose_from, rotation_from_vector, vector_from_rotation
from workbench.pieces import styled, svg
from workbench.plugins.calibration.methods import Centres
from workbench.plugins.calibration.model import Noise
from workbench.plugins.calibration.observations import from_arrays
from workbench.report.marks import FACES, GREY, MEASURED
from workbench.units import DEG, Float

BOXES_DEG = (1.0, 2.0, 5.0, 20.0)
PRINTED = {  # sphere centres of Table 1, mm
    "analytic": [
        (1863.43, 230.98, 1121.68),
        (1863.48, 230.36, 1121.68),
        (1863.64, 239.07, 1121.50),
        (1862.59, 222.94, 1120.47),
        (1864.20, 223.35, 1122.45),
        (1864.88, 223.38, 1123.27),
        (1863.43, 230.98, 1121.11),
        (1863.88, 230.28, 1121.98),
        (1864.48, 231.35, 1122.89),
    ],
    "GA": [
        (1890.30, 241.75, 1079.77),
        (1890.25, 241.75, 1079.85),
        (1890.23, 241.64, 1079.83),
        (1890.46, 240.91, 1079.75),
        (1890.38, 240.96, 1079.81),
        (1890.38, 240.83, 1079.75),
        (1890.35, 241.80, 1079.64),
        (1890.33, 241.77, 1079.49),
        (1890.31, 241.90, 1079.60),
    ],
}


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


def rows(trials: int) -> Iterator[str]:
    """Means and spreads of the rows that Table 1 prints."""
    found = []
    for name, printed in PRINTED.items():
        values = np.array(printed)
        figures = (values.mean(axis=0), values.std(axis=0, ddof=1), values.std(axis=0))
        found.append([name, *(", ".join(f"{v:.4f}" for v in each) for each in figures)])
    yield from markdown(["rows of", "mean x, y, z, mm", "standard deviation (n - 1)", "standard deviation (n)"], found)


def flat(trials: int) -> Iterator[str]:
    """Equation (6) about the truth: how much it rises over what noise leaves at its minimum."""
    found = []
    for moved, words in ((False, "three postures, three times each"), (True, "three orientations, three places each")):
        rise = {turn: [] for turn in BOXES_DEG}  # type: dict[float, list[float]]
        for seed in range(trials):
            rng = np.random.default_rng(seed)
            seen = measured(rng, moved).centres
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            for turn in BOXES_DEG:
                turned = np.stack([TRUE[:3, :3], rotation_from_vector(axis * turn * DEG) @ TRUE[:3, :3]])
                at_truth, away = turn_cost(seen, turned)
                rise[turn].append(away / at_truth)
        found.append([words, *(f"{np.median(rise[turn]):.3g}" for turn in BOXES_DEG)])
    head = ["measurements", *(f"g({turn:g} deg off) / g(truth)" for turn in BOXES_DEG)]
    yield from markdown(head, found)


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


def starts(trials: int) -> Iterator[str]:
    """Gauss-Newton on all six parameters at once, the signs of h known, from starts far off."""
    found = []
    for turn, shift in ((20.0, 50.0), (60.0, 150.0), (120.0, 300.0)):
        reached = 0
        for seed in range(trials):
            rng = np.random.default_rng(seed)
            seen = measured(rng, True).centres
            axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
            start = pose_from(rotation_from_vector(axis * turn * DEG) @ TRUE[:3, :3], TRUE[:3, 3] + shift * way)
            covariance = np.tile(np.diag([1e-5, 1e-5, 1e-2]), (9, 1, 1))
            circle = np.stack([seen.P[:, 0], seen.P[:, 2], 25 - seen.P[:, 1] ** 2], axis=1)
            noise = Noise()
            end = with_signs(start, seen, from_arrays(circle, covariance, pose_from(seen.r, seen.t)), noise)
            best = with_signs(TRUE, seen, from_arrays(circle, covariance, pose_from(seen.r, seen.t)), noise)
            reached += bool(np.linalg.norm(end.translation_mm - best.translation_mm) < 1e-3)
        found.append([f"{turn:g} deg and {shift:g} mm", f"{reached} of {trials}"])
    yield from markdown(["start off by", "ends where a start at the truth ends"], found)


def diameter(trials: int) -> Iterator[str]:
    """The Cramer-Rao bound against the sphere's diameter, its centre as many radii off the plane."""
    found = []
    for size in (10.0, 15.0, 20.0, 25.0):
        bounds = []
        for seed in range(trials):
            cell = cell_of(random_sphere_recipe("sphere_nine", seed))
            centre = cell.centre * [1.0, size / 10, 1.0]
            shift = (centre - cell.centre) @ cell.hand_eye[:3, :3].T
            turned = cell.turned.copy()
            turned[:, :3, 3] -= (turned[:, :3, :3] @ shift[..., None])[..., 0]
            other = replace(cell, turned=turned, centre=centre, radius_mm=size / 2)
            bounds.append(other.vol_u_mm(bound(other, circles(other, np.random.default_rng(0))[1], 0.05)))
        found.append([f"{size:g} mm", f"{np.sqrt(np.mean(np.square(bounds))):.4f}"])
    yield from markdown(["sphere", "bound over the field, nine postures, mm"], found)


STATEMENTS = {
    "table1": table1,
    "rows": rows,
    "flat": flat,
    "equations": equations,
    "starts": starts,
    "diameter": diameter,
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
