"""Whether an answer is determined: asked of its predicted uncertainty, and answered in words.

The rank of a matrix does not tell (noise makes degenerate sets full rank) and the scatter of what is seen does not
either (it is small along what nothing determines). The predicted uncertainty does: of the translation where the target
was seen, of the rotation as a displacement at the field's edge, and of the clock's offset as motion of the scans.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from workbench.api import DEG, Float, InputError, inverse, vector_from_rotation
from workbench.plugins.calibration.model import Estimate, View, carried, volume_u
from workbench.plugins.calibration.observations import Flange, posture_of

MIN_POSTURES, SAME = 4, (3.0, 1 * DEG)  # mm and rad, within which they are one
ALIKE_RAD = 3 * DEG  # orientations that differ by less hardly count
ALIKE_MM = 1.5  # places of what is seen likewise
OFFSET_MM = 0.2  # largest uncertainty of the clock's offset, as motion of the scans
MOVE_DIFFERENTLY = (
    "all scans move alike, so the clock's offset cannot be told from a shift along the motion: scan back and forth, "
    "and across"
)


class Demand(NamedTuple):
    """What the answer must be good for."""

    view: View
    limit_mm: float  # largest uncertainty of a point, RMS over the field
    where: str  # the recording

    def refuse(self, said: str) -> None:
        """Refuse the recording where something is said against it."""
        if said:
            raise InputError(self.where, said)


def directions(covariance: Float, estimate: Estimate, view: View) -> tuple[tuple[str, float], ...]:
    """The six principal directions of the uncertainty, worst first: in words, and the uncertainty in mm.

    From the hand-eye covariance (6, 6). Rotations are about the middle of the field of view and count by what they
    move at the RMS distance of its points.
    """
    R = estimate.rotation
    change = carried(R.T, view.axes(R)[0])  # to the profiler's axes: translation of the middle, rotation times lever
    change[3:] *= view.lever_mm
    values, vectors = np.linalg.eigh(change @ covariance @ change.T)
    return tuple((_words(vectors[:, i]), float(np.sqrt(max(values[i], 0.0)))) for i in range(5, -1, -1))


def check_postures(flange: Flange, where: str, what: str, because: str = "") -> None:
    """Refuse fewer than four postures; frames of a scan are judged by the uncertainty alone."""
    poses = flange.base_from_flange
    if not flange.scans and (count := int(posture_of(poses, *SAME).max()) + 1) < MIN_POSTURES:
        raise InputError(
            where,
            f"expected at least {MIN_POSTURES} distinct postures that see the {what}, found {count} in {len(poses)} "
            f"passes: hand-eye pose and {what} stay undetermined; turn the flange about two axes and move the {what} "
            f"through the field of view{because}",
        )


def too_open(covariance: Float, estimate: Estimate, demand: Demand, cause: Callable[[], str]) -> str:
    """Which direction a covariance (6, 6) leaves more uncertain than the limit, and why; empty: none."""
    view, limit_mm, _ = demand
    total = volume_u(covariance, estimate.rotation, view)
    if total <= limit_mm:
        return ""
    found = directions(covariance, estimate, view)
    also = sum(u > limit_mm for _, u in found[1:])
    more = f" and {also} more direction{'s' * (also > 1)}" if also else ""
    size = f"{total:.3g} mm" if total < 1000 else "more than a metre"
    return (
        f"the postures do not determine {found[0][0]}{more} well enough: predicted uncertainty {size} over the field "
        f"of view of {2 * view.half_mm[0]:.0f} by {2 * view.half_mm[1]:.0f} mm, allowed {limit_mm:g} mm (max_u_mm); "
        f"{cause()}"
    )


def offset_open(u_s: float, flange: Flange) -> str:
    """Why a clock's offset is no answer that only the noise of the scans' motion tells; empty: it is one."""
    speed_mm_s = speed_of(flange)
    if u_s * speed_mm_s <= OFFSET_MM:
        return ""
    return (
        f"the scans do not determine the clock's offset: predicted uncertainty {1e3 * u_s:.3g} ms, "
        f"{u_s * speed_mm_s:.2g} mm of motion, allowed {OFFSET_MM:g} mm; {MOVE_DIFFERENTLY}"
    )


def speed_of(flange: Flange) -> float:
    """Greatest, mm/s."""
    return float(np.linalg.norm(flange.velocity[:, :3], axis=1).max())


def _words(v: Float) -> str:
    """A direction (6,) of translation and scaled rotation in the profiler's axes, in words."""
    turns = (v[3:] @ v[3:]) > 0.5
    part = v[3:] if turns else v[:3]
    part = part / np.linalg.norm(part)
    part = part * np.sign(part[np.abs(part).argmax()])
    axis = "xyz"[int(np.abs(part).argmax())]
    along = (
        f"the profiler's {axis}"
        if np.abs(part).max() > 0.97
        else "({:.2f}, {:.2f}, {:.2f}) in profiler axes".format(*part)
    )
    return f"the rotation about {along}" if turns else f"the translation along {along}"


def cause_of(base_from_flange: Float, centre: Float, with_offset: bool, what: str) -> str:
    """Why a set of poses (k, 4, 4) is weak, and what would mend it; what is seen, at (k, 3) in the profiler frame."""
    between = inverse(base_from_flange[:1]) @ base_from_flange
    turns = vector_from_rotation(between[:, :3, :3])
    turning, spread = (
        np.linalg.svd(one - one.mean(axis=0), compute_uv=False) / np.sqrt(len(one)) for one in (turns, centre)
    )
    if turning[0] < ALIKE_RAD:
        return "all postures have nearly the same orientation: turn the flange about two different axes"
    if turning[1] < ALIKE_RAD:
        apart = np.linalg.norm(turns - turns[0], axis=1)
        other = np.linalg.norm(turns - turns[apart.argmax()], axis=1)
        if (np.minimum(apart, other) < ALIKE_RAD).all():
            return "there are only two orientations: add a third, turned about another axis"
        return "all postures turn about one axis: turn the flange about a second one"
    if spread[0] < ALIKE_MM:
        return f"the {what} lies at one point of the profile in all postures: move it through the field of view"
    if spread[1] < ALIKE_MM:
        return f"the {what} lies on one line of the field of view: spread it over its width and depth"
    if with_offset:
        return MOVE_DIFFERENTLY
    return f"add postures that differ in orientation and in where the {what} lies in the profile"
