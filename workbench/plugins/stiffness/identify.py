"""`stiffness.identify`: the joints' stiffness from loading tests."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.stats import chi2

from workbench.api import (
    DEG,
    AngleConvention,
    Cell,
    Chain,
    Document,
    Float,
    InputError,
    InputFile,
    LoadingSetup,
    abb_angles,
    stage,
    within_limits,
)
from workbench.plugins.stiffness.equations import Equations, equations
from workbench.plugins.stiffness.estimate import Estimate, robust, solve
from workbench.plugins.stiffness.loads import read_loads
from workbench.plugins.stiffness.mistakes import PLAUSIBLE_NM_PER_RAD, explain, mean_stiffness
from workbench.plugins.stiffness.observability import reason, unobserved
from workbench.plugins.stiffness.pairs import check_pairs
from workbench.plugins.stiffness.read import stiffness_document
from workbench.plugins.stiffness.rigid import check_rigid
from workbench.plugins.stiffness.values import JointStiffness, LoadingTests

MANY = 0.1  # share of loads or points: where more contradict the rest, it is no gross error here and there


@stage("stiffness.identify")
def identify(
    cell: Cell,
    *,
    loads: Annotated[InputFile, Field(description="loading tests, a loads.csv")],
    angle_convention: Annotated[AngleConvention, Field(description="how the file's joint angles count")] = "abb",
    largest_relative_u: Annotated[
        float, Field(gt=0, le=1, description="ratio of standard uncertainty to value above which a joint is refused")
    ] = 0.5,
) -> tuple[JointStiffness, Document]:
    """Identify the joints' stiffness from loads and displacements (the paper's sections 5.2 and 6.2, eq. (24)).

    Weighted least squares for the compliance, with the noise of displacement and wrench out of the cell file, the
    sensor's wrench brought to the joints by (27) and (28) put right, and the second order of the deflection. Gross
    errors are put aside: tracked points that leave the rigid body, loads that contradict the rest.

    Args:
        cell: the cell; its `loading` says where sensor, tool and targets sit.
        loads: the tests: one row a load, wrench and displacement as loaded minus unloaded.
        angle_convention: of the file's angles; the contract has the controller's (abb).
        largest_relative_u: a joint less certain than this is refused, with the reason.

    Raises:
        InputError: an unusable file; a mistake of signs, units, axes or conventions that explains the misfit; a joint
            that the loads cannot determine.
    """
    if cell.loading is None:
        raise InputError(f"{cell.source}: $.loading", "expected where sensor, tool and targets sit; it is missing")
    tests = read_loads(loads)
    tests = dataclasses.replace(tests, joints=abb_angles(tests.joints, angle_convention))
    _check_limits(cell.chain, tests, angle_convention)
    found, notes = identify_from(cell.chain, cell.loading, tests, largest_relative_u)
    return found, stiffness_document(found, **notes)


def identify_from(chain: Chain, setup: LoadingSetup, tests: LoadingTests,
                  largest_relative_u: float = 0.5) -> tuple[JointStiffness, dict[str, object]]:  # fmt: skip
    """Stiffness from tests in memory, their angles the controller's; and what the result file adds to it."""
    sound, points_out = check_rigid(chain, setup, tests)
    eq = equations(chain, setup, sound)
    found, use = robust(eq)
    points = 0 if tests.targets_mm is None else tests.targets_mm.size / 3
    many = len(points_out) > MANY * points or (use == 0).sum() > MANY * len(use)
    judged = solve(equations(chain, setup, tests), np.ones(len(use))) if many else found
    mistake = explain(chain, setup, tests, judged, largest_relative_u)
    if mistake:
        raise InputError(tests.source, mistake)
    _check_observed(found, eq, chain, setup, sound, largest_relative_u)
    _check_size(found, tests)
    loads_out = tuple(f"line {tests.lines[i]}: this load contradicts the others: left out"
                      for i in np.flatnonzero(use == 0))  # fmt: skip
    noisy = found.scale2 > chi2.ppf(0.999, found.freedom) / found.freedom
    spread = (f"residuals are {np.sqrt(found.scale2):.2f} times what the cell's noise predicts: uncertainties are "
              "widened by that",) if noisy else ()  # fmt: skip
    pairs = check_pairs(sound, eq, found.compliance, use, found.scale2)
    covariance = found.covariance * (found.scale2 if noisy else 1.0)
    stiffness = _stiffness(found, covariance, sound, use, (*tests.warnings, *points_out, *loads_out, *spread, *pairs))
    notes: dict[str, object] = {
        "joint_compliance_rad_per_nm": found.compliance,
        "compliance_covariance": covariance,
        "residual_over_noise": float(np.sqrt(found.scale2)),
        "rejected": [*points_out, *loads_out],
    }
    return stiffness, notes


def _stiffness(found: Estimate, covariance: Float, tests: LoadingTests, use: Float,
               warnings: tuple[str, ...]) -> JointStiffness:  # fmt: skip
    """Stiffness as the reciprocal of the compliance.

    The compliance is normal and unbiased, its reciprocal is not: its mean is high by the relative variance, and its
    variance has terms of fourth order, which count where a joint is known to 10 or 20 % only.
    """
    k = 1 / found.compliance
    relative = covariance * np.outer(k, k)
    r = np.diag(relative)
    fourth = relative * np.outer(1 + 3 * r, 1 + 3 * r) + 2 * relative**2
    values = np.linalg.eigvalsh(np.linalg.inv(relative))
    used = [tests.labels[i] for i in np.flatnonzero(use)]
    return JointStiffness(
        nm_per_rad=k / (1 + r), covariance=fourth * np.outer(k, k),
        condition_number=float(np.sqrt(values[-1] / values[0])), postures=len(set(used)), loads=len(used),
        source=tests.source, warnings=warnings,
    )  # fmt: skip


def _check_limits(chain: Chain, tests: LoadingTests, convention: AngleConvention) -> None:
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


def _check_observed(found: Estimate, eq: Equations, chain: Chain, setup: LoadingSetup, tests: LoadingTests,
                    largest_relative_u: float) -> None:  # fmt: skip
    lost = unobserved(found, largest_relative_u)
    if lost:
        why = {j: reason(j, found, eq, chain, setup, tests) for j in sorted(lost)}
        texts = {text: [str(j + 1) for j in why if why[j] == text] for text in why.values()}
        lines = [f"joint{'s' if len(j) > 1 else ''} {' and '.join(j)} cannot be determined: {text}"
                 for text, j in texts.items()]  # fmt: skip
        raise InputError(tests.source, "; ".join(lines))


def _check_size(found: Estimate, tests: LoadingTests) -> None:
    """All lengths or all forces in another unit fit as well as they should, but to an impossible robot."""
    mean = mean_stiffness(found)
    low, high = PLAUSIBLE_NM_PER_RAD
    if not low <= mean <= high:
        cause = "displacements in m, or wrenches in mN" if mean > high else "wrenches in kN, or displacements too large"
        raise InputError(
            tests.source,
            f"expected joint stiffness of some 1e5 to 1e7 Nm/rad, found a mean of {mean:.2g}: "
            f"are units mixed by a factor of 1,000 ({cause})?",
        )
