"""The root size along the edge, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from workbench.artefacts import Edge
from workbench.geometry.end_posterior import end_at
from workbench.geometry.ends import Ends, fit_end
from workbench.inspect.angles import BevelAngles
from workbench.units import Bool, Float

# A root face that leans to and fro by its roughness also stands out and back, by about its lean over this many times
# its width: that shifts its corner with the bevel, and what the root size there means is not known any better.
ROUGH_LEVER = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class RootSizes:
    """Root size at m places of the edge."""

    root_mm: Float  # (m,) NaN where not measured
    end_u_mm: Float  # (m,) parts of its standard uncertainty: returns at the ends of the root face
    corner_u_mm: Float  # (m,) the bevel face's own line
    tilt_u_mm: Float  # (m,) the root face's direction, one for all places
    rough_u_mm: Float  # (m,) its roughness
    turned_u_mm: Float  # (m,) the edge's direction
    passes_u_mm: Float  # (m,) what no frame shows

    @property
    def u_mm(self) -> Float:
        """(m,) combined standard uncertainty."""
        parts = (self.end_u_mm, self.corner_u_mm, self.tilt_u_mm, self.rough_u_mm, self.turned_u_mm, self.passes_u_mm)
        return np.sqrt(sum(part**2 for part in parts))

    def where(self, mask: Bool) -> RootSizes:
        """The places where `mask` (m,) holds."""
        return RootSizes(*(getattr(self, field.name)[mask] for field in fields(self)))


def root_sizes(edge: Edge, at_mm: Float, angles: BevelAngles) -> RootSizes:
    """Root size at arc lengths at_mm (m,).

    Each frame measures from its own corner of root face and bevel face, so vibration and robot error cancel; where the
    lower edge is a silhouette, the likelihoods of all frames near the place are multiplied.
    """
    f = edge.frames
    assert f is not None, "a raw edge: measure_at refuses it"
    frames = np.flatnonzero(np.isfinite(f.root_low_mm) & np.isfinite(f.arc_length_mm) & np.isfinite(f.root_sigma_mm))
    frames = frames[np.argsort(f.arc_length_mm[frames], kind="stable")]
    s, step, sigma = f.arc_length_mm[frames], f.root_step_mm[frames], f.root_sigma_mm[frames]
    ends = Ends(s, f.root_low_mm[frames], step, sigma, f.missing[frames], f.root_weight[frames])
    root, end_u = end_at(ends, fit_end(ends), at_mm)
    lever = np.interp(at_mm, s, f.bevel_lever_mm[frames])
    cot = 1.0 / np.tan(angles.bevel)
    apart = np.interp(at_mm, s, np.abs(f.arc_length_mm - f.lower_arc_length_mm)[frames])
    return RootSizes(
        root_mm=root, end_u_mm=end_u, corner_u_mm=lever / np.sin(angles.bevel) * angles.local_u,
        tilt_u_mm=0.5 * root * np.abs(cot) * angles.tilt_u,
        rough_u_mm=ROUGH_LEVER * root * np.abs(cot) * angles.tilt_scatter,
        turned_u_mm=edge.tangent_u * apart, passes_u_mm=np.full(root.shape, edge.root_u_mm),
    )  # fmt: skip
