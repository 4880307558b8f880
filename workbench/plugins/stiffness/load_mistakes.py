"""What people get wrong in loading tests, and what each mistake would look like: signs, conventions, units, axes.

A mistake is tried only when the loads fit badly, say nothing or ask for an impossible robot: the data are read once
more as if it had been made, and it is named if they then make sense.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np

from workbench.api import Chain, Float, LoadingSetup, abb_angles, forward_kinematics, within_limits
from workbench.plugins.stiffness.equations import Equations, covariances, equations
from workbench.plugins.stiffness.estimate import Estimate, solve
from workbench.plugins.stiffness.loads import DISPLACEMENT, WRENCH
from workbench.plugins.stiffness.observability import SURE
from workbench.plugins.stiffness.values import LoadingTests

MISFIT = 3.0  # ratio of the residuals' variance to the noise's that asks for a reason, and that a reason must mend
EXPLAINED = 0.3  # share of the displacements' square that may be left over, for a reading that makes sense
TURNED = ("", -1.0)  # unit and factor: an axis reversed
LENGTHS = (("m", 1e3), ("micrometres", 1e-3))
PLAUSIBLE_NM_PER_RAD = (3e3, 3e7)  # geometric mean over the joints of an industrial robot, with room on both sides


def makes_sense(found: Estimate, largest_relative_u: float) -> bool:
    """Whether an estimate is of a possible robot, and known well enough."""
    u = found.u * np.sqrt(max(found.scale2, 1.0))
    if not (found.compliance > 0).all() or (u > largest_relative_u * found.compliance).any():
        return False
    return PLAUSIBLE_NM_PER_RAD[0] < mean_stiffness(found) < PLAUSIBLE_NM_PER_RAD[1]


def _possible(found: Estimate) -> bool:
    """Whether nothing but too large an uncertainty speaks against an estimate."""
    sure = found.compliance > -SURE * found.u * np.sqrt(max(found.scale2, 1.0))
    known = found.compliance[found.compliance > SURE * found.u]
    low, high = PLAUSIBLE_NM_PER_RAD
    return bool(sure.all()) and (not len(known) or low < np.exp(-np.mean(np.log(known))) < high)


def mean_stiffness(found: Estimate) -> float:
    """Geometric mean over the joints, Nm/rad."""
    return float(np.exp(-np.mean(np.log(found.compliance))))


def explain(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, found: Estimate, largest_relative_u: float
) -> str | None:
    """The mistake that explains best why an estimate fits badly or makes no sense, in words; None: none does."""
    sense = makes_sense(found, largest_relative_u)
    if found.scale2 < MISFIT and (sense or (found.scale2 > 1 / MISFIT and _possible(found))):
        return None
    away = np.log(max(found.scale2 / MISFIT, MISFIT))
    fits = []
    for what, changed in _readings(chain, tests):
        eq = equations(chain, setup, changed)
        other = solve(eq, np.ones(len(tests.lines)))
        share = _share_left(eq, other)
        if makes_sense(other, largest_relative_u) and share < EXPLAINED and abs(np.log(other.scale2)) < away:
            fits.append((abs(np.log(other.scale2)) + np.log(share), what))
    return min(fits)[1] if fits else None


def _share_left(eq: Equations, found: Estimate) -> float:
    """Square of the residuals over that of the displacements, both over the noise."""
    variance = np.diagonal(covariances(eq, np.abs(found.compliance)), axis1=1, axis2=2)
    return float(np.sum(found.residual**2 / variance) / np.sum((eq.y * eq.seen) ** 2 / variance))


def _readings(chain: Chain, tests: LoadingTests) -> Iterator[tuple[str, LoadingTests]]:
    """Each mistake in words, and the tests as they are if it was made."""
    yield (
        "the wrench and the displacement have opposite signs: the file's wrench must be the one that acts on the robot",
        dataclasses.replace(tests, wrench=-tests.wrench),
    )
    for convention in ("dh", "dh_same_sense"):
        joints = abb_angles(tests.joints, convention)
        if np.isfinite(within_limits(chain, joints)).all():
            yield (
                f"the joint angles are Denavit-Hartenberg ones: set angle_convention to '{convention}'",
                dataclasses.replace(tests, joints=joints),
            )
    yield "the joint angles are in rad, not deg", dataclasses.replace(tests, joints=np.degrees(tests.joints))
    rotation = forward_kinematics(chain, tests.joints)[:, :3, :3]
    yield "the wrench is in base axes, not in the sensor's", _turned(tests, np.swapaxes(rotation, 1, 2), None)
    yield "the displacement is in flange axes, not in the base's", _turned(tests, None, rotation)
    yield from _units(tests)


def _turned(tests: LoadingTests, of_wrench: Float | None, of_displacement: Float | None) -> LoadingTests:
    def turn(rotation: Float | None, values: Float | None) -> Float | None:
        if rotation is None or values is None:
            return values
        triples = values.reshape(len(values), -1, 3)
        return (rotation[:, None] @ triples[..., None])[..., 0].reshape(values.shape)

    wrench = turn(of_wrench, tests.wrench)
    assert wrench is not None
    return dataclasses.replace(
        tests,
        wrench=wrench,
        displacement=turn(of_displacement, tests.displacement),
        targets_mm=turn(of_displacement, tests.targets_mm),
    )


def _units(tests: LoadingTests) -> Iterator[tuple[str, LoadingTests]]:
    """Single columns and groups of columns that are a factor off, or of the other sign."""
    yield "the wrench is 1,000 times too small: in kN and kNm?", dataclasses.replace(tests, wrench=1e3 * tests.wrench)
    of_wrench = {"n": (TURNED, ("kN", 1e3), ("mN", 1e-3)), "nm": (TURNED, ("Nmm", 1e-3), ("kNm", 1e3))}
    for columns, factor, unit in _factors(WRENCH, of_wrench):
        scaled = tests.wrench.copy()
        scaled[:, [WRENCH.index(name) for name in columns]] *= factor
        yield _in_words(columns, factor, unit), dataclasses.replace(tests, wrench=scaled)
    if tests.displacement is not None:
        both = tests.displacement * ([1e3] * 3 + [180 / np.pi] * 3)
        yield "displacements are in m and rad, not mm and deg", dataclasses.replace(tests, displacement=both)
        kinds = {"mm": (TURNED, *LENGTHS), "deg": (TURNED, ("rad", 180 / np.pi), ("mrad", 0.18 / np.pi))}
        for columns, factor, unit in _factors(DISPLACEMENT, kinds):
            scaled = tests.displacement.copy()
            scaled[:, [DISPLACEMENT.index(name) for name in columns]] *= factor
            yield _in_words(columns, factor, unit), dataclasses.replace(tests, displacement=scaled)
    elif tests.targets_mm is not None:
        names = tuple(f"p{k + 1}{x}_mm" for k in range(tests.targets_mm.shape[1]) for x in "xyz")
        for columns, factor, unit in _factors(names, {"mm": (TURNED, *LENGTHS)}):
            flat = tests.targets_mm.reshape(len(tests.lines), -1).copy()
            flat[:, [names.index(name) for name in columns]] *= factor
            yield (
                _in_words(columns, factor, unit),
                dataclasses.replace(tests, targets_mm=flat.reshape(tests.targets_mm.shape)),
            )


def _factors(
    names: tuple[str, ...], kinds: Mapping[str, tuple[tuple[str, float], ...]]
) -> Iterator[tuple[tuple[str, ...], float, str]]:
    """Columns, what brings them to the unit in their name, and the unit they would be in."""
    for suffix, mistakes in kinds.items():
        group = tuple(name for name in names if name.rpartition("_")[2] == suffix)
        for unit, factor in mistakes:
            for columns in (*((name,) for name in group), group):
                yield columns, factor, unit


def _in_words(columns: tuple[str, ...], factor: float, unit: str) -> str:
    which = f"column {columns[0]} is" if len(columns) == 1 else f"columns {columns[0]} to {columns[-1]} are"
    if factor < 0:
        return f"{which} of the wrong sign: is the axis reversed?"
    times = f"{factor:,.5g} times too small" if factor > 1 else f"{1 / factor:,.5g} times too large"
    return f"{which} {times}: in {unit}?"
