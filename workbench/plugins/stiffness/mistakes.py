"""What people get wrong in loading tests, and what each mistake would look like: signs, conventions, units, axes.

A mistake is tried only when the loads fit badly or ask for negative stiffness: the data are read once more as if it had
been made, and it is named if they then fit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np

from workbench.api import Chain, Float, LoadingSetup, abb_angles, forward_kinematics, within_limits
from workbench.plugins.stiffness.equations import equations
from workbench.plugins.stiffness.estimate import Estimate, solve
from workbench.plugins.stiffness.loads import DISPLACEMENT, WRENCH
from workbench.plugins.stiffness.values import LoadingTests

BETTER = 10.0  # how many times smaller the misfit must become
SURE = 3.0  # standard uncertainties by which a compliance counts as negative


def suspicious(found: Estimate) -> bool:
    """Whether the loads fit much worse than their noise, or ask for a negative stiffness."""
    return found.scale2 > BETTER or not _possible(found)


def explain(chain: Chain, setup: LoadingSetup, tests: LoadingTests, found: Estimate) -> str | None:
    """The mistake that explains the misfit best, in words; None: none does."""
    enough = found.scale2 / BETTER if _possible(found) else max(4.0, 2 * found.scale2)
    fits = []
    for what, changed in _readings(chain, tests):
        other = solve(equations(chain, setup, changed), np.ones(len(tests.lines)))
        if _possible(other) and other.scale2 < enough:
            fits.append((other.scale2, what))
    return min(fits)[1] if fits else None


def _possible(found: Estimate) -> bool:
    return bool((found.compliance > -SURE * found.u * np.sqrt(max(found.scale2, 1.0))).all())


def _readings(chain: Chain, tests: LoadingTests) -> Iterator[tuple[str, LoadingTests]]:
    """Each mistake in words, and the tests as they are if it was made."""
    yield (
        "the wrench and the displacement have opposite signs: the file's wrench must be the one that acts on the robot",
        dataclasses.replace(tests, wrench=-tests.wrench),
    )
    for convention in ("dh", "dh_same_sense"):
        joints = abb_angles(tests.joints, convention)
        if np.isfinite(within_limits(chain, joints)).all():
            yield (f"the joint angles are Denavit-Hartenberg ones: set angle_convention to '{convention}'",
                   dataclasses.replace(tests, joints=joints))  # fmt: skip
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
    return dataclasses.replace(tests, wrench=wrench, displacement=turn(of_displacement, tests.displacement),
                               targets_mm=turn(of_displacement, tests.targets_mm))  # fmt: skip


def _units(tests: LoadingTests) -> Iterator[tuple[str, LoadingTests]]:
    """Single columns and groups of columns that are a factor off."""
    for columns, factor, unit in _factors(
        WRENCH, {"n": (("kN", 1e3), ("mN", 1e-3)), "nm": (("Nmm", 1e-3), ("kNm", 1e3))}
    ):
        scaled = tests.wrench.copy()
        scaled[:, [WRENCH.index(name) for name in columns]] *= factor
        yield _in_words(columns, factor, unit), dataclasses.replace(tests, wrench=scaled)
    if tests.displacement is not None:
        kinds = {"mm": (("m", 1e3), ("micrometres", 1e-3)), "deg": (("rad", 180 / np.pi), ("mrad", 0.18 / np.pi))}
        for columns, factor, unit in _factors(DISPLACEMENT, kinds):
            scaled = tests.displacement.copy()
            scaled[:, [DISPLACEMENT.index(name) for name in columns]] *= factor
            yield _in_words(columns, factor, unit), dataclasses.replace(tests, displacement=scaled)
    elif tests.targets_mm is not None:
        names = tuple(f"p{k + 1}{x}_mm" for k in range(tests.targets_mm.shape[1]) for x in "xyz")
        for columns, factor, unit in _factors(names, {"mm": (("m", 1e3), ("micrometres", 1e-3))}):
            flat = tests.targets_mm.reshape(len(tests.lines), -1).copy()
            flat[:, [names.index(name) for name in columns]] *= factor
            yield (_in_words(columns, factor, unit),
                   dataclasses.replace(tests, targets_mm=flat.reshape(tests.targets_mm.shape)))  # fmt: skip


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
    times = f"{factor:,.5g} times too small" if factor > 1 else f"{1 / factor:,.5g} times too large"
    return f"{which} {times}: in {unit}?"
