"""The paper's Fig. 5 in simulation: sphere centres by the analytic way and by the genetic algorithm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from bench.calibration.postures import Measured, measured, sphere_centres
from bench.calibration.two_steps import analytic, genetic
from workbench.pieces import styled, svg
from workbench.report.colours import FACES, GREY, MEASURED
from workbench.units import Float

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
