"""A profile as a small drawing (SVG): points, straight lines, corners."""

from __future__ import annotations

import numpy as np

from workbench.look.single import Profile
from workbench.units import Float

WIDTH, HEIGHT, MARGIN = 1000.0, 380.0, 40.0
MOST_POINTS = 4000


def profile_drawing(profile: Profile) -> str:
    """SVG; x to the right, z upwards, the same scale for both where that leaves something to see."""
    x, z = profile.x_mm, profile.z_mm
    low, high = np.array([x.min(), z.min()]), np.array([x.max(), z.max()])
    span = np.maximum(high - low, 1e-6)
    scale = np.array([(WIDTH - 2 * MARGIN) / span[0], (HEIGHT - 2 * MARGIN) / span[1]])

    def at(points_mm: Float) -> Float:
        seen = MARGIN + (points_mm - low) * scale
        return np.stack([seen[:, 0], HEIGHT - seen[:, 1]], axis=1)

    some = at(np.stack([x, z], axis=1)[:: max(1, len(x) // MOST_POINTS)])
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
