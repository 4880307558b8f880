"""The page of `workbench look`: summary, checks, a profile drawn, the view in the browser; it needs no network."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from workbench.artefacts import Scene, Shading
from workbench.look.command import summary
from workbench.look.seen import MOST_POINTS, Profile, Seen, Shade, limit_text
from workbench.report.html import packed, policy
from workbench.report.text import environment, source
from workbench.units import Float

WIDTH, HEIGHT, MARGIN = 1000.0, 380.0, 40.0
DRAWN_POINTS = 4000


def profile_drawing(profile: Profile) -> str:
    """SVG; x to the right, z upwards, the same scale for both where that leaves something to see."""
    x, z = profile.x_mm, profile.z_mm
    low, high = np.array([x.min(), z.min()]), np.array([x.max(), z.max()])
    span = np.maximum(high - low, 1e-6)
    scale = np.array([(WIDTH - 2 * MARGIN) / span[0], (HEIGHT - 2 * MARGIN) / span[1]])

    def at(points_mm: Float) -> Float:
        seen = MARGIN + (points_mm - low) * scale
        return np.stack([seen[:, 0], HEIGHT - seen[:, 1]], axis=1)

    some = at(np.stack([x, z], axis=1)[:: max(1, len(x) // DRAWN_POINTS)])
    dots = "".join(f"M{px:.1f} {py:.1f}h.01" for px, py in some)
    parts = [f'<path d="{dots}" stroke="#6b7280" stroke-width="2.4" stroke-linecap="round" fill="none"/>']
    for line in profile.lines:
        ends = at(np.array([[v, line.slope * v + line.offset_mm] for v in line.x_mm]))
        parts.append(
            f'<line x1="{ends[0, 0]:.1f}" y1="{ends[0, 1]:.1f}" x2="{ends[1, 0]:.1f}" y2="{ends[1, 1]:.1f}" '
            'stroke="#0072b2" stroke-width="1.5"/>'
        )
    for number, corner in enumerate(profile.corners, 1):
        ((px, py),) = at(np.array([[corner.x_mm, corner.z_mm]]))
        parts.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="5" fill="none" stroke="#d55e00" stroke-width="2"/>')
        parts.append(f'<text x="{px + 8:.1f}" y="{py - 6:.1f}" font-size="13">{number}</text>')
    ruler = (
        f'<text x="{MARGIN}" y="{HEIGHT - 8:.0f}" font-size="13">x {low[0]:.4g} mm</text>'
        f'<text x="{WIDTH - MARGIN}" y="{HEIGHT - 8:.0f}" font-size="13" text-anchor="end">{high[0]:.4g} mm</text>'
        f'<text x="{MARGIN}" y="16" font-size="13">z {low[1]:.5g} to {high[1]:.5g} mm '
        f"(drawn {scale[1] / scale[0]:.3g} times as high as wide)</text>"
    )
    return f'<svg viewBox="0 0 {WIDTH:.0f} {HEIGHT:.0f}" role="img" aria-label="profile">{"".join(parts)}{ruler}</svg>'


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
