"""The page of `workbench look`: summary, checks, the view in the browser; one file that needs no network."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from workbench.artefacts import Scene, Shading
from workbench.look.command import summary
from workbench.look.drawing import profile_drawing
from workbench.look.sample import MOST_POINTS
from workbench.look.seen import Seen, Shade
from workbench.look.tell import limit_text
from workbench.report.page import packed, policy
from workbench.report.text import environment, source

# Anchors of a ramp from dark to light that keeps its order with any colour vision, and in grey.
RAMP = np.array([[68, 1, 84], [65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81]], float)
SHARE = (1.0, 99.0)  # per cent of the values that the ramp spans; strays do not wash it out


def page(found: Seen) -> str:
    """The whole page."""
    viewer = source("painter.js") + source("viewer.js")
    scene = scene_of(found)
    return (
        environment("workbench.look")
        .get_template("look.html.j2")
        .render(
            found=found,
            lines=summary(found)[1:],
            limit_text=limit_text,
            style=source("page.css"),
            viewer=viewer,
            policy=policy(viewer),
            scene=Markup(packed(scene, MOST_POINTS)) if scene is not None else "",
            drawing=Markup(profile_drawing(found.profile))
            if found.profile is not None and len(found.profile.x_mm)
            else "",
        )
    )


def scene_of(found: Seen) -> Scene | None:
    """What is turned in the browser; None where there is nothing."""
    strokes = tuple(one for one in found.strokes if one.lines_mm)
    if not len(found.points_mm) and not strokes:
        return None
    shadings = tuple(_shading(shade) for shade in found.shades) if len(found.points_mm) else ()
    return Scene(found.points_mm, shadings, strokes, (), np.eye(3), axes_names=("x", "y", "z"))


def _shading(shade: Shade) -> Shading:
    low, high = np.percentile(shade.values, SHARE)
    if not high > low:
        low, high = float(shade.values.min()), float(shade.values.max())
    steps = np.linspace(0.0, 1.0, 256)
    palette = np.stack([np.interp(steps, np.linspace(0.0, 1.0, len(RAMP)), RAMP[:, k]) for k in range(3)], axis=1)
    index = np.round(255.0 * np.clip((shade.values - low) / max(high - low, 1e-12), 0.0, 1.0)).astype(np.uint8)
    legend = tuple(
        (f"{low + part * (high - low):.6g}", "#{:02x}{:02x}{:02x}".format(*palette[round(255 * part)].astype(int)))
        for part in (0.0, 0.25, 0.5, 0.75, 1.0)
    )
    return Shading(shade.name, index, palette.astype(np.uint8), legend)
