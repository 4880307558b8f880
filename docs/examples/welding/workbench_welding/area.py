"""The cross-section of a weld groove and its uncertainty: arrays in, arrays out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.api import Float


@dataclass(frozen=True)
class Joint:
    """What the inspection of one plate does not know: the other plate, the thickness and the gap. Uncertainties are
    standard uncertainties.
    """

    thickness_mm: float  # of the plates
    thickness_u_mm: float
    gap_mm: float  # between the root faces
    gap_u_mm: float
    bevelled_plates: int  # 1: single bevel groove, against a square edge; 2: single-V groove, against its mirror image


def groove_area_mm2(root_mm: Float, bevel: Float, joint: Joint) -> Float:
    """Area A = g T + (p/2) (T - c)^2 tan(beta) between the plates, without excess weld metal.

    g gap, T thickness, p bevelled plates, c root face (n,) in mm, beta bevel angle (n,) in rad. Root faces are square
    to the plates (ISO 9692-1, grooves 1.3 and 1.9.1).
    """
    height_mm = joint.thickness_mm - root_mm
    return np.asarray(joint.gap_mm * joint.thickness_mm + joint.bevelled_plates / 2 * height_mm**2 * np.tan(bevel))


def groove_area_u_mm2(root_mm: Float, root_u_mm: Float, bevel: Float, bevel_u: Float, joint: Joint) -> Float:
    """Standard uncertainty (n,) of the area, in mm2: JCGM 100 (GUM), 5.1.2, root face and bevel angle (rad) taken as
    independent. The mirror image of a plate has the plate's own errors: they count twice, not by the root of two.
    """
    height_mm, p = joint.thickness_mm - root_mm, joint.bevelled_plates
    by_root_mm = -p * height_mm * np.tan(bevel)
    by_bevel_mm2 = p / 2 * height_mm**2 / np.cos(bevel) ** 2
    by_thickness_mm = joint.gap_mm + p * height_mm * np.tan(bevel)
    parts = (
        by_root_mm * root_u_mm,
        by_bevel_mm2 * bevel_u,
        by_thickness_mm * joint.thickness_u_mm,
        joint.thickness_mm * joint.gap_u_mm,
    )
    return np.asarray(np.sqrt(sum(np.square(part) for part in parts)))
