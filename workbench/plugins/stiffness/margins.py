"""How far a cut is from chatter at the places of a path, for postures that are chosen and for those that are judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.api import COVERAGE, AnyArray, Cell, Chain, Cutter, Float, InputError, Int, Shaped, Toolpath, estimator
from workbench.plugins.stiffness.dynamics import at_tool
from workbench.plugins.stiffness.stability import Dynamics, Milling, limits, milling, screened
from workbench.plugins.stiffness.values import CuttingProcess, MillingForce, RobotModes

SAME_MM = 0.05  # radial depths that count as one
STEP = 0.05  # of a logarithm, by which sensitivities are found
FEWER = 3  # places at which a posture is screened, of the layer whose cut is widest
LARGEST_MM = 500.0  # depth that is looked at
JUDGED_MM = 100.0  # by the judge


@dataclass(frozen=True, slots=True, eq=False)
class Cuts:
    """The loaded points of a path: how the cutter meets the material there."""

    cutter: Cutter
    process: CuttingProcess
    rpm: float
    at: Shaped[Int, " m"]  # of all postures
    base_from_tool: Shaped[Float, "m 4 4"]  # a point's axes, where the force acts
    force_n: Shaped[Float, "m 3"]  # mean, base axes
    radial_mm: Shaped[Float, " m"]
    axial_mm: Shaped[Float, " m"]
    chip_mm: Shaped[Float, " m"]  # feed per tooth

    def only(self, index: AnyArray) -> Cuts:
        """Some of the points."""
        columns = ("at", "base_from_tool", "force_n", "radial_mm", "axial_mm", "chip_mm")
        return replace(self, **{name: getattr(self, name)[index] for name in columns})

    def spread(self, count: int) -> Cuts:
        """So many at most, evenly."""
        return self.only(np.unique(np.linspace(0, len(self.at) - 1, count).astype(int)))

    def in_motion(self, motion: Float) -> Cuts:
        """The points (m,) in c motions of the part (c, m, 4, 4) or (c, 1, 4, 4), one motion's after the other's."""
        frames = (motion @ self.base_from_tool).reshape(-1, 4, 4)
        push = (motion[..., :3, :3] @ self.force_n[..., None]).reshape(-1, 3)
        same = self.only(np.tile(np.arange(len(self.at)), len(motion)))
        return replace(same, base_from_tool=frames, force_n=push)

    def milling(self, radial_mm: float) -> tuple[Milling, Milling]:
        """Up and down, at a radial depth."""
        k = self.process.coefficients
        chip = (k.ktc_n_mm2, k.krc_n_mm2, k.kac_n_mm2)
        return milling(chip, self.cutter.flutes, self.cutter.diameter_mm, radial_mm, self.process.helix, self.rpm)

    @property
    def groups(self) -> list[tuple[float, AnyArray]]:
        """Radial depths that occur and the points (bool, m) that have each."""
        rounded = np.maximum(np.round(self.radial_mm / SAME_MM), 1) * SAME_MM
        return [(depth, rounded == depth) for depth in np.unique(rounded)]

    def dynamics(self, chain: Chain, modes: RobotModes, joints: Float) -> Dynamics:
        """Of the robot at the points, with joints (m, 6)."""
        return at_tool(chain, modes, joints, self.base_from_tool, self.force_n)


def cuts_of(toolpath: Toolpath, force: MillingForce, layer: Int, base_from_point: Float) -> Cuts:
    """The points that cut, of all points (n,) of a path by their layers, 0 in travels, at frames (n, 4, 4).

    Raises:
        InputError: the force is of another path, has no coefficients, or nothing is cut.
    """
    if force.process is None:
        raise InputError("milling force", "expected its coefficients and depths, as stiffness.force makes it")
    radial, axial, mean = (force.at_points(layer, name) for name in ("radial_mm", "axial_mm", "mean_n"))
    at = np.flatnonzero((radial > 0) & (axial > 0))
    if not len(at):
        raise InputError("milling force", "expected points where the cutter is loaded, found none")
    feed = np.zeros(len(layer))
    feed[layer != 0] = np.concatenate([one.feed_mm_s for one in toolpath.layers])
    return Cuts(
        cutter=toolpath.cutter,
        process=force.process,
        rpm=force.spindle_rpm,
        at=at,
        base_from_tool=base_from_point[at],
        force_n=(base_from_point[at, :3, :3] @ mean[at, :, None])[..., 0],
        radial_mm=radial[at],
        axial_mm=axial[at],
        chip_mm=feed[at] * 60 / (force.spindle_rpm * toolpath.cutter.flutes),
    )


def screen_limits(dynamics: Dynamics, cuts: Cuts, way: int, *, regeneration: bool = True) -> Float:
    """Limits (m,), mm, of the averaged cut: `way` 0 as the path runs (up-milling), 1 backwards."""
    return _by_depth(dynamics, cuts, way, lambda some, cut: screened(some, cut, LARGEST_MM, regeneration=regeneration))


def judged_limits(dynamics: Dynamics, cuts: Cuts, way: int, largest_mm: float) -> Float:
    """The judge's limits (m,), mm; its search begins well below what the screen says."""

    def judge(some: Dynamics, cut: Milling) -> Float:
        return limits(some, cut, largest_mm, np.minimum(screened(some, cut, LARGEST_MM) / 4, largest_mm / 30))

    return _by_depth(dynamics, cuts, way, judge)


def _by_depth(dynamics: Dynamics, cuts: Cuts, way: int, rule: Callable[[Dynamics, Milling], Float]) -> Float:
    """What a rule says of all points (m,), those of one radial depth together."""
    found = np.full(len(cuts.at), np.inf)
    for radial, here in cuts.groups:
        found[here] = rule(Dynamics(*(part[here] for part in dynamics)), cuts.milling(radial)[way])
    return found


def first_limit(
    dynamics: Dynamics, cuts: Cuts, way: int, depth_mm: Float, speeds: Sequence[float] = (1.0,), sure: float = 0.0
) -> float:
    """Share of its depth, of (m,), at which the judge first finds a limit, at shares `speeds` of the speed; inf: none.

    Below `sure` times a depth the screen's word is taken.
    """
    share = screen_limits(dynamics, cuts, way) / depth_mm
    if share.min() < sure:
        return float(share.min())
    for i in np.argsort(share).tolist():  # what fails, fails at once
        for by in speeds:
            one = replace(cuts.only(np.array([i])), rpm=cuts.rpm * by)
            limit = judged_limits(dynamics.at(i), one, way, depth_mm[i])[0]
            if np.isfinite(limit):
                return float(limit / depth_mm[i])
    return np.inf


def u_of_modes(chain: Chain, modes: RobotModes, cuts: Cuts, joints: Float, way: int = 0) -> Float:
    """Standard uncertainty (m,) of the logarithm of the limit by masses, stiffness and damping, by the screen."""

    def limit(step: Float) -> Float:
        return np.log(screen_limits(cuts.dynamics(chain, modes.moved(step), joints), cuts, way))[:, None]

    with np.errstate(invalid="ignore", divide="ignore"):
        slope = estimator.jacobian_of(limit, np.full(len(modes.covariance), STEP))
    slope = np.nan_to_num(slope[:, 0], posinf=0.0, neginf=0.0)
    return np.asarray(np.sqrt(np.einsum("mp,pq,mq->m", slope, modes.covariance, slope)))


@dataclass(frozen=True, slots=True, eq=False)
class Steadiness:
    """The margin from chatter that a posture must keep all along a path: limit over depth, less U."""

    cell: Cell
    modes: RobotModes
    cuts: Cuts  # with the turntable where it was when the path was planned
    asked: float
    stations: int  # that are judged

    @property
    def few(self) -> Cuts:
        """Where the screen looks: along the stretch whose cut is widest."""
        wide = self.cuts.axial_mm * np.sqrt(self.cuts.radial_mm)
        return self.cuts.only(np.flatnonzero(wide >= 0.98 * wide.max())).spread(FEWER)

    def margins(self, joints: Float, motion: Float) -> tuple[Float, Float]:
        """The least margin (c,) and the same less its U, by the screen, of postures (c, FEWER, 6) and c motions.

        Where the margin itself is too small, U is not looked for: both are the same.
        """
        count = joints.shape[1]
        cuts, flat = self.few.in_motion(motion), joints.reshape(-1, 6)
        limit = screen_limits(cuts.dynamics(self.cell.chain, self.modes, flat), cuts, 0)
        margin = (limit / cuts.axial_mm).reshape(-1, count)
        worst, least = margin.argmin(axis=1) + count * np.arange(len(margin)), margin.min(axis=1)
        left, good = least.copy(), np.flatnonzero((least >= self.asked) & np.isfinite(least))
        if len(good):
            left[good] *= np.exp(-COVERAGE * self._u(cuts.only(worst[good]), flat[worst[good]]))
        return least, left

    def falls_to(self, joints: Float, motion: Float) -> float:
        """The margin less U that the judge finds where it is first below the one asked; infinite: it nowhere is.

        Postures (n, 6) at all points, motions (n, 4, 4).
        """
        cuts, dynamics, by_u = self._judged(joints, motion)
        return self.asked * first_limit(dynamics, cuts, 0, self.asked * by_u * cuts.axial_mm)

    def least(self, joints: Float, motion: Float) -> float:
        """The least margin less U all along the path, as `stiffness.chatter` finds it; infinite: no limit is near."""
        cuts, dynamics, by_u = self._judged(joints, motion)
        return float((judged_limits(dynamics, cuts, 0, JUDGED_MM) / cuts.axial_mm / by_u).min())

    def _judged(self, joints: Float, motion: Float) -> tuple[Cuts, Dynamics, Float]:
        """The places at which the judge looks, and by how much U divides their margins."""
        some = self.cuts.spread(self.stations)
        there, q = some.in_motion(motion[None, some.at]), joints[some.at]
        return there, there.dynamics(self.cell.chain, self.modes, q), np.exp(COVERAGE * self._u(there, q))

    def _u(self, cuts: Cuts, joints: Float) -> Float:
        return np.hypot(
            u_of_modes(self.cell.chain, self.modes, cuts, joints), self.cuts.process.coefficients.relative_u
        )
