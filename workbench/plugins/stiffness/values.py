"""The values that stages of the stiffness plug-in exchange. Nm/rad, N, Nm, mm, rad."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.api import DEG, Bodies, Float, InputError, Int, Shaped, estimator
from workbench.plugins.stiffness.coefficients import CuttingCoefficients

Six = tuple[float, float, float, float, float, float]  # of the joints
TABLE_2_NM_PER_RAD = (1.77e6, 3.43e6, 0.85e6, 0.87e6, 0.50e6, 0.14e6)  # the paper's Table 2
DISPLACEMENT = ("dx_mm", "dy_mm", "dz_mm", "rx_deg", "ry_deg", "rz_deg")
TABLE_A1_DEG = ((0, 93, -5, 45, 45, 45), (0, 113, -26, 45, 45, 45), (0, 88, -12, 45, 45, 45))  # Denavit-Hartenberg


@dataclass(frozen=True, slots=True, eq=False)
class JointStiffness:
    """Torsional stiffness of the six joints, gearboxes and drives included, as springs about their axes."""

    nm_per_rad: Shaped[Float, " 6"]  # > 0
    covariance: Shaped[Float, "6 6"]  # of them, (Nm/rad)^2
    condition_number: float  # of the weighted problem, each joint's compliance in units of itself; 0: not identified
    postures: int  # that it rests on
    loads: int
    source: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def u_nm_per_rad(self) -> Float:
        """Standard uncertainties (6,)."""
        return estimator.standard_u(self.covariance)


@dataclass(frozen=True, slots=True)
class ToolMode:
    """A mode of spindle and cutter, the same in all directions across the cutter's axis and at all postures."""

    frequency_hz: float
    damping_ratio: float
    stiffness_n_per_um: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotModes:
    """A robot of rigid links on springs and dampers about its joints."""

    nm_per_rad: Shaped[Float, " 6"]
    bodies: Bodies  # the tool on the sixth link
    damping: Shaped[Float, " *d"]  # of all modes alike, a ratio (1,); or of each joint (6,), Nm s/rad
    covariance: Shaped[Float, "p p"]  # of the logarithms of stiffness, masses and damping, 12 + d
    tool: ToolMode | None = None
    declared: tuple[str, ...] = ()  # what nobody measured
    misfit: float | None = None  # chi-square of tap tests over its degrees of freedom; None: no tap tests
    warnings: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """Of the parameters."""
        damping = ["damping ratio"] if len(self.damping) == 1 else [f"damping of joint {i}" for i in range(1, 7)]
        return [*(f"{what} {i}" for what in ("stiffness of joint", "mass of link") for i in range(1, 7)), *damping]

    def moved(self, step: Float) -> RobotModes:
        """With the logarithms of all parameters changed by `step` (p,)."""
        by = np.exp(step)
        bodies = Bodies(
            self.bodies.mass_kg * by[6:12], self.bodies.centre_mm, self.bodies.inertia_kg_m2 * by[6:12, None, None]
        )
        return replace(self, nm_per_rad=self.nm_per_rad * by[:6], bodies=bodies, damping=self.damping * by[12:])


@dataclass(frozen=True, slots=True, eq=False)
class PathStability:
    """Limiting depths of cut at m places of a path, mm; infinite: none up to the largest that was looked at."""

    at: Shaped[Int, " m"]  # of the postures' points
    layer: Shaped[Int, " m"]
    arc_length_mm: Shaped[Float, " m"]  # along the edge
    depth_mm: Shaped[Float, " m"]  # of the cut, along the cutter
    up_limit_mm: Shaped[Float, " m"]  # as the path runs
    down_limit_mm: Shaped[Float, " m"]  # the path run backwards
    coupling_limit_mm: Shaped[Float, " m"]  # of mode coupling alone, milling up
    u_log: Shaped[Float, " m"]  # standard uncertainty of the logarithm of a limit
    spindle_rpm: float
    largest_mm: float  # depth that was looked at
    warnings: tuple[str, ...] = ()

    @property
    def worst(self) -> int:
        """The place of least margin."""
        return int(self.margin.argmin())

    @property
    def words(self) -> str:
        """Limits at the worst place."""
        k = self.worst
        up, down = (
            f"from {limit:.2g} mm" if np.isfinite(limit) else f"none up to {self.largest_mm:g} mm"
            for limit in (self.up_limit_mm[k], self.down_limit_mm[k])
        )
        where = f"{self.arc_length_mm[k]:.0f} mm along layer {self.layer[k]}, {self.depth_mm[k]:.1f} mm deep"
        return (
            f"At the worst place, {where}: milling up (as the path runs) chatter {up}; "
            f"milling down (the path backwards) {down}"
        )

    @property
    def margin(self) -> Float:
        """Limiting over actual depth (m,), milling up."""
        return self.up_limit_mm / self.depth_mm

    @property
    def least_margin(self) -> Float:
        """The margin less its U (k = 2), of its logarithm (m,)."""
        return self.margin * np.exp(-2.0 * self.u_log)


@dataclass(frozen=True, slots=True, eq=False)
class Deflection:
    """Displacement of the cutter's tip under a wrench at one posture, in base axes."""

    displacement_mm: Shaped[Float, " 3"]
    rotation: Shaped[Float, " 3"]  # rotation vector, rad
    joints: Shaped[Float, " 6"]  # how far each joint gives way, rad
    tangent_stiffness: Shaped[Float, "6 6"]  # eq. (17) at the loaded posture: N, Nm per m, rad


@dataclass(frozen=True, slots=True, eq=False)
class LoadingTests:
    """Loading tests as recorded: L loads; wrench and displacement are loaded minus unloaded."""

    source: str
    labels: tuple[str, ...]  # of the posture of each load
    lines: tuple[int, ...]  # of the file, for messages
    joints: Shaped[Float, "L 6"]  # rad, in the convention of the file
    wrench: Shaped[Float, "L 6"]  # N, Nm: acts on the robot, in the sensor frame
    moved: Shaped[Float, "L r"]  # in the base: of the tool frame, mm and rad, or of points, mm; NaN: not seen
    points: int  # that were tracked, three columns each; 0: the tool frame's displacement and rotation vector
    warnings: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """Of a file, for `moved`."""
        return moved_columns(self.points)

    @property
    def units(self) -> Float:
        """What 1 in each of these columns (r,) is in `moved`."""
        return np.array([DEG if name.endswith("_deg") else 1.0 for name in self.columns])

    @property
    def vectors(self) -> Float:
        """`moved` as vectors (L, 2 or points, 3)."""
        return self.moved.reshape(len(self.moved), -1, 3)


def moved_columns(points: int) -> tuple[str, ...]:
    """Columns of a file for the displacement of tracked points, or of the tool frame where there are none."""
    return tuple(f"p{k}{x}_mm" for k in range(1, points + 1) for x in "xyz") if points else DISPLACEMENT


@dataclass(frozen=True, slots=True, eq=False)
class LayerForce:
    """Force on the cutter at the k points of a layer of a milling path, N. It acts at the point, on the flank.

    In the point's axes: x into the material, y along the feed, z from shank to tip.
    """

    index: int  # of the layer
    arc_length_mm: Shaped[Float, " k"]
    mean_n: Shaped[Float, "k 3"]  # over a revolution, in the point's axes
    peak_n: Shaped[Float, "k 3"]  # where the revolution's force is greatest
    torque_nm: Shaped[Float, " k"]  # that the spindle gives, mean of a revolution
    radial_mm: Shaped[Float, " k"]  # depths of cut; 0 in travel moves
    axial_mm: Shaped[Float, " k"]
    u_mean_n: Shaped[Float, "k 3"] | None = None  # of mean_n, by the coefficients alone; None: nobody states theirs


@dataclass(frozen=True, slots=True, eq=False)
class CuttingProcess:
    """What makes the force along a path, but for the depths."""

    coefficients: CuttingCoefficients
    helix: float  # rad


@dataclass(frozen=True, slots=True, eq=False)
class MillingForce:
    """Milling force along a path."""

    layers: tuple[LayerForce, ...]
    source: str  # of the coefficients
    spindle_rpm: float
    assumed: str = ""  # what stands in for what nobody stated: programs say so
    process: CuttingProcess | None = None  # None: nobody knows it, and no stability is told

    def at_points(self, layer: Int, column: str) -> Float:
        """A column of the layers at all points of a path by their layer (n,); 0 in travel moves, whose layer is 0.

        Raises:
            InputError: the force is of another path.
        """
        rows = [getattr(one, column) for one in self.layers]
        owner = np.repeat([one.index for one in self.layers], [len(row) for row in rows])
        acts = np.concatenate(rows)
        if not np.array_equal(owner, layer[layer != 0]) or not np.isfinite(acts).all():
            raise InputError("milling force", "expected that of this path, point by point")
        found = np.zeros((len(layer), *acts.shape[1:]))
        found[layer != 0] = acts
        return found


@dataclass(frozen=True, slots=True, eq=False)
class LoadPlan:
    """Planned loading tests: L loads in pairs of opposite ones, and what they promise."""

    labels: tuple[str, ...]  # of the posture of each load
    joints: Shaped[Float, "L 6"]  # rad, the controller's angles
    points_mm: Shaped[Float, "L 3"]  # where the force acts, in the flange frame
    force_n: Shaped[Float, "L 3"]  # in the flange's axes
    wrench: Shaped[Float, "L 6"]  # N, Nm in the sensor frame
    noise_relative_u: Shaped[Float, " 6"]  # standard uncertainty of each joint's stiffness over its value, by noise
    relative_u: Shaped[Float, " 6"]  # likewise by noise and all else that `stiffness.identify` holds
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class StiffnessMaps:
    """Dexterity and the weight of K_c over two axes, a x b grid points; worst over the load's directions."""

    axes: tuple[int, int]  # from 1
    at: tuple[Float, Float]  # (a,), (b,) rad
    inverse_dexterity: Shaped[Float, "a b"]  # 1/omega, 1/m^3; infinite where singular
    fp: Shaped[Float, "a b"]
    fr: Shaped[Float, "a b"]  # rad
    marked: Shaped[Float, "p 6"]  # rad
    marked_values: Shaped[Float, "p 3"]  # 1/omega, f_p, f_r there
    verdict: str  # whether K_c is negligible
