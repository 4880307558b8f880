"""What loading tests must be, before and after their equations are solved; each refusal is one line.

What people get wrong has a look of its own: signs, conventions, units, axes. A mistake is tried only when the loads fit
badly, say nothing or ask for an impossible robot: the data are read once more as if it had been made, and it is named
if they then make sense.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from workbench.api import (
    DEG,
    AngleConvention,
    Chain,
    Float,
    InputError,
    LoadingSetup,
    abb_angles,
    estimator,
    forward_kinematics,
    within_limits,
)
from workbench.plugins.stiffness.beyond_springs import LackOfFit
from workbench.plugins.stiffness.equations import SURE, Equations, Loading, equations, reason, unobserved
from workbench.plugins.stiffness.read_stage import WRENCH
from workbench.plugins.stiffness.values import JointStiffness, LoadingTests

MISFIT = 3.0  # ratio of the residuals' variance to the noise's that asks for a reason, and that a reason must mend
EXPLAINED = 0.3  # share of the displacements' square that may be left over, for a reading that makes sense
REVERSAL = ("", -1.0)  # unit and factor: an axis reversed
LENGTHS = (("m", 1e3), ("micrometres", 1e-3), ("inches", 25.4))
PLAUSIBLE_NM_PER_RAD = (3e3, 3e7)  # geometric mean over the joints of an industrial robot, with room on both sides
COARSE = 5.0  # standard deviations of the noise: rounded to 0.1 mm of 0.015, stiffness was up to 4.5 u off
LEAST_DISTINCT = 10  # readings
STIFFER = {  # what makes the joints how many times as stiff as they are
    "is the wrench in lbf (4.448 N)": 1 / 4.448,
    "is the wrench in kgf (9.807 N)": 1 / 9.807,
    "are displacements in inches": 25.4,
}
UNLIKE = 3.0  # times what is stated: robots of a type, or cutters in one alloy, differ by less, units by more
CLIPPED, CLIPPED_SHARE, NEARLY, FINE = 4, 0.5, 0.99, 1e-3  # loads at the end of a range; of those within 1 % of it


def makes_sense(found: estimator.Fit[Float], largest_relative_u: float) -> bool:
    """Whether an estimate is of a possible robot, and known well enough."""
    if not (found.at > 0).all() or unobserved(found.at, found.covariance, largest_relative_u):
        return False
    return PLAUSIBLE_NM_PER_RAD[0] < mean_stiffness(found.at) < PLAUSIBLE_NM_PER_RAD[1]


def _possible(found: estimator.Fit[Float]) -> bool:
    """Whether nothing but too large an uncertainty speaks against an estimate."""
    sure = found.at > -SURE * estimator.standard_u(found.covariance)
    known = found.at[found.at > SURE * estimator.standard_u(found.inverse)]
    low, high = PLAUSIBLE_NM_PER_RAD
    return bool(sure.all()) and (not len(known) or low < mean_stiffness(known) < high)


def mean_stiffness(compliance: Float) -> float:
    """Geometric mean over the joints, Nm/rad."""
    return float(np.exp(-np.mean(np.log(compliance))))


def explain(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, found: estimator.Fit[Float], largest_relative_u: float
) -> str | None:
    """The mistake that explains best why an estimate fits badly or makes no sense, in words; None: none does.

    A second one that explains it half as well is named behind it.
    """
    sense = makes_sense(found, largest_relative_u)
    if found.misfit < MISFIT and (sense or (found.misfit > 1 / MISFIT and _possible(found))):
        return None
    away = np.log(max(found.misfit / MISFIT, MISFIT))
    fits = []
    for what, changed in _readings(chain, tests):
        other = Loading(equations(chain, setup, changed)).fit()
        variance = np.diagonal(other.rows.covariance, axis1=1, axis2=2)
        moved = other.rows.residual + other.rows.jacobian @ other.at
        share = np.sum(other.rows.residual**2 / variance) / np.sum(moved**2 / variance)
        if makes_sense(other, largest_relative_u) and share < EXPLAINED and abs(np.log(other.misfit)) < away:
            fits.append((abs(np.log(other.misfit)) + np.log(share), what))
    fits = sorted(fits)[:2]
    return "; or ".join(what for score, what in fits if score < fits[0][0] + np.log(2.0)) or None


def _readings(chain: Chain, tests: LoadingTests) -> Iterator[tuple[str, LoadingTests]]:
    """Each mistake in words, and the tests as they are if it was made."""
    yield (
        "the wrench and the displacement have opposite signs: the file's wrench must be the one that acts on the robot",
        replace(tests, wrench=-tests.wrench),
    )
    for convention in ("dh", "dh_same_sense"):
        joints = abb_angles(tests.joints, convention)
        if np.isfinite(within_limits(chain, joints)).all():
            yield (
                f"the joint angles are Denavit-Hartenberg ones: set angle_convention to '{convention}'",
                replace(tests, joints=joints),
            )
    yield "the joint angles are in rad, not deg", replace(tests, joints=np.degrees(tests.joints))
    for what, joints in _other_zeros(tests.joints):
        if np.isfinite(within_limits(chain, joints)).all():
            yield what, replace(tests, joints=joints)
    rotation = forward_kinematics(chain, tests.joints)[:, :3, :3]
    yield (
        "the wrench is in base axes, not in the sensor's",
        replace(tests, wrench=_rotated(tests.wrench, rotation.mT)),
    )
    yield (
        "the displacement is in flange axes, not in the base's",
        replace(tests, moved=_rotated(tests.moved, rotation)),
    )
    yield from _units(tests)


def _other_zeros(joints: Float) -> Iterator[tuple[str, Float]]:
    """What is taken for angles (L, 6) of the robot model, in words, and these."""
    for j in range(joints.shape[1]):
        turned = joints * np.where(np.arange(joints.shape[1]) == j, -1.0, 1.0)
        yield f"column q{j + 1}_deg is of the wrong sign: does the controller count that joint the other way?", turned
    for sign in (1.0, -1.0):
        level = joints.copy()
        level[:, 2] += sign * joints[:, 1]
        yield "column q3_deg is counted from the horizontal (FANUC), not from link 2", level


def _rotated(values: Float, rotation: Float) -> Float:
    """Rows (L, 3 k) of k vectors, turned by rotations (L, 3, 3)."""
    triples = np.einsum("lij,lkj->lki", rotation, values.reshape(len(values), -1, 3))
    return np.asarray(triples.reshape(values.shape))


def _units(tests: LoadingTests) -> Iterator[tuple[str, LoadingTests]]:
    """Single columns and groups of columns that are a factor off, or of the other sign."""
    yield "the wrench is 1,000 times too small: in kN and kNm?", replace(tests, wrench=1e3 * tests.wrench)
    if not tests.points:
        both = tests.moved * ([1e3] * 3 + [180 / np.pi] * 3)
        yield "displacements are in m and rad, not mm and deg", replace(tests, moved=both)
    for field, names in (("wrench", WRENCH), ("moved", tests.columns)):
        for columns, factor, unit in _factors(names):
            scaled = getattr(tests, field).copy()
            scaled[:, [names.index(name) for name in columns]] *= factor
            yield _in_words(columns, factor, unit), replace(tests, **{field: scaled})


def _factors(names: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], float, str]]:
    """Columns, what brings them to the unit in their name, and the unit they would be in."""
    kgf, lbf = scipy.constants.kgf, scipy.constants.lbf
    mistaken = {  # by the unit in a column's name: what it may be in, and the factor that mends it
        "n": (REVERSAL, ("kN", 1e3), ("mN", 1e-3), ("kgf", kgf), ("lbf", lbf)),
        "nm": (REVERSAL, ("Nmm", 1e-3), ("kNm", 1e3), ("kgf m", kgf), ("kgf cm", 1e-2 * kgf)),
        "mm": (REVERSAL, *LENGTHS),
        "deg": (REVERSAL, ("rad", 180 / np.pi), ("mrad", 0.18 / np.pi)),
    }
    for suffix, mistakes in mistaken.items():
        group = tuple(name for name in names if name.rpartition("_")[2] == suffix)
        for unit, factor in mistakes if group else ():
            for columns in (*((name,) for name in group), group):
                yield columns, factor, unit


def _in_words(columns: tuple[str, ...], factor: float, unit: str) -> str:
    which = f"column {columns[0]} is" if len(columns) == 1 else f"columns {columns[0]} to {columns[-1]} are"
    if factor < 0:
        return f"{which} of the wrong sign: is the axis reversed?"
    times = f"{factor:,.5g} times too small" if factor > 1 else f"{1 / factor:,.5g} times too large"
    return f"{which} {times}: in {unit}?"


def check_filled(tests: LoadingTests) -> None:
    """Columns of zeros are no tests."""
    if not tests.wrench.any():
        raise InputError(tests.source, "loads without wrench: every force and torque is 0")
    filled = np.nan_to_num(tests.moved).any(axis=0)
    if not filled.any():
        raise InputError(tests.source, "loads without displacement: every displacement is 0")
    if not (tests.points or filled.all()):
        empty = tests.columns[int(filled.argmin())]
        raise InputError(
            tests.source,
            f"column {empty} is 0 in every load: expected what was measured; where no rotations were measured, give "
            "tracked points p1x_mm ... instead",
        )


def counted_once(tests: LoadingTests) -> LoadingTests:
    """The tests without loads that stand in the file again, figure by figure: they are no further evidence."""
    whole = np.nan_to_num(np.column_stack([tests.joints, tests.wrench, tests.moved]), nan=np.inf)
    first = np.sort(np.unique(whole, axis=0, return_index=True)[1])
    again = len(whole) - len(first)
    if not again or not tests.wrench.any():
        return tests
    return replace(
        tests,
        labels=tuple(tests.labels[i] for i in first),
        lines=tuple(tests.lines[i] for i in first),
        joints=tests.joints[first],
        wrench=tests.wrench[first],
        moved=tests.moved[first],
        warnings=(*tests.warnings, f"{again} loads stand in the file again, figure by figure: counted once"),
    )


def _is_measured(values: Float) -> bool:
    """Whether values (n,) differ as readings do; weights and levers, written down as nominal ones, are few."""
    distinct = len(np.unique(np.abs(values)))
    return distinct >= LEAST_DISTINCT and distinct > 0.5 * len(values)


def step_of(values: Float) -> float:
    """The greatest step 1, 2 or 5 times a power of ten of which all values (n,) are multiples; 0: of none."""
    largest = np.nanmax(np.abs(values), initial=0.0)
    if largest == 0.0:
        return 0.0
    steps = np.outer(10.0 ** (np.floor(np.log10(largest)) - np.arange(7)), [5.0, 2.0, 1.0]).ravel()
    share = values[np.isfinite(values), None] / steps
    found = steps[np.abs(share - np.round(share)).max(axis=0) < 1e-6]
    return float(found.max(initial=0.0))


def rounded(setup: LoadingSetup, tests: LoadingTests) -> LoadingSetup:
    """The setup with the noise of figures that are rounded: a step s adds s^2 / 6 to the variance.

    That is twice s^2 / 12, since opposite loads and repeated ones are rounded alike.

    Raises:
        InputError: displacements are rounded so coarsely that the error is no noise.
    """

    shifts, turns = (tests.moved, tests.moved[:, :0]) if tests.points else (tests.moved[:, :3], tests.moved[:, 3:])
    changes: dict[str, Any] = {}
    for name, values, most in (
        ("force_noise_n", tests.wrench[:, :3], math.inf),
        ("torque_noise_nm", tests.wrench[:, 3:], math.inf),
        ("target_noise_mm" if tests.points else "displacement_noise_mm", shifts, COARSE),
        ("rotation_noise_deg", turns / DEG, math.inf),
    ):
        noise = getattr(setup, name)
        step = max((step_of(column) for column in values.T if most < math.inf or _is_measured(column)), default=0.0)
        if step > most * noise:
            raise InputError(
                tests.source,
                f"displacements are rounded to {step:g} mm, where the cell file states a noise of {noise:g} mm: small "
                "ones vanish; give more figures",
            )
        changes[name] = np.hypot(noise, step / np.sqrt(6.0))
    return setup.model_copy(update=changes)


def check_clipped(tests: LoadingTests) -> None:
    """A force sensor at the end of its range repeats its greatest reading to the last figure; noise does not."""
    for name, column in zip(WRENCH, tests.wrench.T, strict=True):
        size = np.abs(column)
        at_most = int((size == size.max()).sum())
        fine = step_of(column) < FINE * size.max()
        nearly = int((size > NEARLY * size.max()).sum())
        below = size[size < size.max()]
        if fine and at_most >= CLIPPED and _is_measured(below) and at_most > CLIPPED_SHARE * nearly:
            raise InputError(
                tests.source,
                f"column {name} stands at {size.max():.6g} to the last figure in {at_most} loads: the sensor is at the "
                "end of its range, or the wrench was not measured; use smaller loads",
            )


def check_stated(found: JointStiffness, stated: Float, source: str, tests: LoadingTests) -> None:
    """All loads in kgf or lbf fit as well as they should: only what is known of this robot tells."""
    ratio = float(np.exp(np.mean(np.log(found.nm_per_rad / stated))))
    if likely := unlike(ratio, STIFFER):
        raise InputError(
            tests.source,
            f"the joints would be {ratio:.2g} times as stiff as {source} states: {likely}? or is that another robot's "
            "stiffness (take it out)?",
        )


def unlike(ratio: float, causes: Mapping[str, float]) -> str | None:
    """The cause, of those with the ratio each makes, that best explains one of found to stated; None: as stated."""
    if max(ratio, 1 / ratio) <= UNLIKE:
        return None
    return min(causes, key=lambda cause: abs(math.log(ratio / causes[cause])))


def check_limits(chain: Chain, tests: LoadingTests, convention: AngleConvention) -> None:
    """Angles beyond the robot's limits are no angles of this robot, or of another convention."""
    beyond = np.isnan(within_limits(chain, tests.joints, tests.joints))
    beyond |= (tests.joints < chain.limits[:, 0] - 1e-6) | (tests.joints > chain.limits[:, 1] + 1e-6)
    if beyond.any() and convention == "abb":
        i, j = np.argwhere(beyond)[0]
        low, high = chain.limits[j] / DEG
        raise InputError(
            f"{tests.source}: line {tests.lines[i]}: q{j + 1}_deg",
            f"expected {low:.5g} to {high:.5g} deg (the robot's limits), found {tests.joints[i, j] / DEG:.5g}; "
            "Denavit-Hartenberg angles need angle_convention 'dh'",
        )


def check_observed(
    compliance: Float, covariance: Float, eq: Equations, tests: LoadingTests, largest: float, lack: LackOfFit
) -> None:
    """Joints that are not known well enough are refused, each with the reason, and with what else may be wrong."""
    lost = unobserved(compliance, covariance, largest)
    if lost:
        force_n = np.linalg.norm(tests.wrench[:, :3], axis=1)
        why = {j: reason(j, compliance, covariance, eq, force_n) for j in sorted(lost)}
        texts = {text: [str(j + 1) for j in why if why[j] == text] for text in why.values()}
        lines = [
            f"joint{'s' if len(j) > 1 else ''} {' and '.join(j)} cannot be determined: {text}"
            for text, j in texts.items()
        ]
        if lack.causes:
            lines.append(f"what would explain the displacements better: {lack.causes}")
        raise InputError(tests.source, "; ".join(lines))


def check_springs(
    compliance: Float, covariance: Float, lack: LackOfFit, tests: LoadingTests, largest_relative_u: float
) -> None:
    """Displacements of which something else than six springs has a large share are refused, and it is named."""
    lost = unobserved(compliance, covariance, largest_relative_u)
    if lost and lack.causes:  # else it is what was declared of the scale
        share = 100 * abs(lack.change[lost[0]] / compliance[lost[0]])
        raise InputError(
            tests.source,
            f"six springs alone do not explain the displacements; what would: {lack.causes}. That would "
            f"change joint {lost[0] + 1} by {share:.0f} %: put it right, here or in the cell file's $.loading",
        )


def check_size(compliance: Float, tests: LoadingTests) -> None:
    """All lengths or all forces in another unit fit as well as they should, but to an impossible robot."""
    mean = mean_stiffness(compliance)
    low, high = PLAUSIBLE_NM_PER_RAD
    if not low <= mean <= high:
        cause = "displacements in m, or wrenches in mN" if mean > high else "wrenches in kN, or displacements too large"
        raise InputError(
            tests.source,
            f"expected joint stiffness of some 1e5 to 1e7 Nm/rad, found a mean of {mean:.2g}: "
            f"are units mixed by a factor of 1,000 ({cause})?",
        )
