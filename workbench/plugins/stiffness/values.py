"""The values that stages of the stiffness plug-in exchange. Nm/rad, N, Nm, mm, rad."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.api import Float

TABLE_2_NM_PER_RAD = (1.77e6, 3.43e6, 0.85e6, 0.87e6, 0.50e6, 0.14e6)  # the paper's Table 2
TABLE_A1_DEG = ((0, 93, -5, 45, 45, 45), (0, 113, -26, 45, 45, 45), (0, 88, -12, 45, 45, 45))  # Denavit-Hartenberg


@dataclass(frozen=True, slots=True, eq=False)
class JointStiffness:
    """Torsional stiffness of the six joints, gearboxes and drives included, as springs about their axes."""

    nm_per_rad: Float  # (6,) > 0
    covariance: Float  # (6, 6) of them, (Nm/rad)^2
    condition_number: float  # of the weighted problem, each joint's compliance in units of itself; 0: not identified
    postures: int  # that it rests on
    loads: int
    source: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def u_nm_per_rad(self) -> Float:
        """Standard uncertainties (6,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, slots=True, eq=False)
class Deflection:
    """Displacement of the cutter's tip under a wrench at one posture, in base axes."""

    displacement_mm: Float  # (3,)
    rotation: Float  # (3,) rotation vector, rad
    joints: Float  # (6,) how far each joint gives way, rad
    tangent_stiffness: Float  # (6, 6) eq. (17) at the loaded posture: N, Nm per m, rad
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class LoadingTests:
    """Loading tests as recorded: L loads; wrench and displacement are loaded minus unloaded."""

    source: str
    labels: tuple[str, ...]  # of the posture of each load
    lines: tuple[int, ...]  # of the file, for messages
    joints: Float  # (L, 6) rad, in the convention of the file
    wrench: Float  # (L, 6) N, Nm: acts on the robot, in the sensor frame
    displacement: Float | None  # (L, 6) of the tool frame, in the base: mm, rotation vector in rad
    targets_mm: Float | None  # (L, k, 3) displacement of tracked points, in the base; NaN: not seen
    warnings: tuple[str, ...] = ()
