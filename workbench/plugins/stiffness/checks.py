"""What loading tests must be before and after their equations are solved; each refusal is one line."""

from __future__ import annotations

import numpy as np

from workbench.api import DEG, AngleConvention, Chain, InputError, LoadingSetup, within_limits
from workbench.plugins.stiffness.equations import Equations
from workbench.plugins.stiffness.estimate import Estimate
from workbench.plugins.stiffness.mistakes import PLAUSIBLE_NM_PER_RAD, mean_stiffness
from workbench.plugins.stiffness.observability import reason, unobserved
from workbench.plugins.stiffness.values import LoadingTests


def check_filled(tests: LoadingTests) -> None:
    """Columns of zeros are no tests."""
    if not tests.wrench.any():
        raise InputError(tests.source, "loads without wrench: every force and torque is 0")
    moved = tests.displacement if tests.targets_mm is None else np.nan_to_num(tests.targets_mm)
    if moved is None or not moved.any():
        raise InputError(tests.source, "loads without displacement: every displacement is 0")


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
    found: Estimate, eq: Equations, chain: Chain, setup: LoadingSetup, tests: LoadingTests, largest_relative_u: float
) -> None:
    """Joints that are not known well enough are refused, each with the reason."""
    lost = unobserved(found, largest_relative_u)
    if lost:
        why = {j: reason(j, found, eq, chain, setup, tests) for j in sorted(lost)}
        texts = {text: [str(j + 1) for j in why if why[j] == text] for text in why.values()}
        lines = [
            f"joint{'s' if len(j) > 1 else ''} {' and '.join(j)} cannot be determined: {text}"
            for text, j in texts.items()
        ]
        raise InputError(tests.source, "; ".join(lines))


def check_size(found: Estimate, tests: LoadingTests) -> None:
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
