"""The uncertainty budget (GUM 5.1): what the combined standard uncertainties are made of, and what they leave out."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Part, Uncertainty, UncertaintySource
from workbench.inspect.angles import BevelAngles
from workbench.inspect.roots import RootSizes
from workbench.units import DEG, Float

NOT_INCLUDED = (
    "Errors of scale and linearity of the profile sensor: its calibration certificate states them.",
    "Position errors of the robot that do not scatter within a pass, such as those of its kinematic calibration.",
    "Thermal expansion: values hold at the temperature of the measurement and are not corrected to 20 °C (ISO 1).",
)
NO_HAND_EYE = "The uncertainty of the hand-eye calibration: none is stated with the pose in use (hand_eye)."


def budget(angles: BevelAngles, roots: RootSizes, part: Part) -> Uncertainty:
    """The sources at the section of the largest uncertainty, of each characteristic by itself.

    `angles` and `roots` are those of the measured sections (m,).
    """
    r = int(np.argmax(roots.u_mm)) if roots.u_mm.size else None
    b = int(np.argmax(angles.u)) if angles.u.size else None

    def root(u_mm: Float) -> float:
        return 0.0 if r is None else float(u_mm[r])

    def bevel(u: Float) -> float:
        return 0.0 if b is None else float(u[b]) / DEG

    turned = np.sqrt(np.maximum(angles.u**2 - angles.local_u**2 - angles.tilt_u**2, 0.0))
    found = (
        UncertaintySource("scatter of the returns at the ends of the root face", root(roots.end_u_mm), 0.0, "A"),
        UncertaintySource("line fit of the bevel face", root(roots.corner_u_mm), bevel(angles.local_u), "A"),
        UncertaintySource("tilt of the root face", root(roots.tilt_u_mm), bevel(angles.tilt_u), "A"),
        UncertaintySource("roughness of the root face", root(roots.rough_u_mm), 0.0, "A"),
        UncertaintySource("direction of the edge: robot position noise and hand-eye pose", root(roots.turned_u_mm),
                          bevel(turned), "B"),
        UncertaintySource("agreement of scanning passes", root(roots.passes_u_mm), 0.0, "B"),
    )  # fmt: skip
    sources = tuple(one for one in found if one.root_u_mm > 0.0 or one.bevel_u_deg > 0.0)
    left_out = NOT_INCLUDED if part.hand_eye_u_mm is not None else (*NOT_INCLUDED, NO_HAND_EYE)
    return Uncertainty(sources=sources, not_included=left_out)
