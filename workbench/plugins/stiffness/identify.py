"""`stiffness.identify`: the joints' stiffness from loading tests."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

import numpy as np
import scipy
from pydantic import Field

from workbench.api import (
    DEG,
    AngleConvention,
    Bool,
    Cell,
    Chain,
    Chapter,
    Document,
    Float,
    InputError,
    InputFile,
    LoadingSetup,
    abb_angles,
    forward_kinematics,
    pieces,
    stage,
    within_limits,
)
from workbench.plugins.stiffness.equations import Equations, covariances, curvature, equations
from workbench.plugins.stiffness.estimate import Estimate, robust, solve
from workbench.plugins.stiffness.load_mistakes import PLAUSIBLE_NM_PER_RAD, explain, mean_stiffness
from workbench.plugins.stiffness.loads import read_loads
from workbench.plugins.stiffness.observability import reason, unobserved
from workbench.plugins.stiffness.read import stiffness_document
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
) -> tuple[JointStiffness, Chapter, Document]:
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

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> found, chapter, file = stiffness.identify(cell, loads="data/synthetic/loads.csv")
        >>> chapter.title, file.name
        ('Joint stiffness', 'stiffness.json')
    """
    if cell.loading is None:
        raise InputError(f"{cell.source}: $.loading", "expected where sensor, tool and targets sit; it is missing")
    tests = read_loads(loads)
    tests = dataclasses.replace(tests, joints=abb_angles(tests.joints, angle_convention))
    check_limits(cell.chain, tests, angle_convention)
    found, notes = identify_from(cell.chain, cell.loading, tests, largest_relative_u)
    chapter = stiffness_chapter(found, tests.labels, notes["residual_over_noise_of_load"], notes["load_used"])
    return found, chapter, stiffness_document(found, **notes)


def identify_from(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, largest_relative_u: float = 0.5
) -> tuple[JointStiffness, dict[str, Any]]:
    """Stiffness from tests in memory, their angles the controller's; and what the result file adds to it."""
    check_filled(tests)
    sound, points_out = check_rigid(chain, setup, tests)
    eq = equations(chain, setup, sound)
    found, use = robust(eq)
    _refuse_mistakes(chain, setup, tests, found, use, len(points_out), largest_relative_u)
    check_observed(found, eq, chain, setup, sound, largest_relative_u)
    check_size(found, tests)
    out = (
        *points_out,
        *(f"line {tests.lines[i]}: this load contradicts the others: left out" for i in np.flatnonzero(use == 0)),
    )
    noisy = found.scale2 > scipy.special.chdtri(found.freedom, 0.001) / found.freedom
    covariance = found.covariance * (found.scale2 if noisy else 1.0)
    warnings = [*tests.warnings, *out, *check_pairs(sound, eq, found.compliance, use, found.scale2)]
    if noisy:
        warnings.append(
            f"residuals are {np.sqrt(found.scale2):.2f} times what the cell's noise predicts: "
            "uncertainties are widened by that"
        )
    return _stiffness(found, covariance, sound, use, tuple(warnings)), {
        "joint_compliance_rad_per_nm": found.compliance,
        "compliance_covariance": covariance,
        "residual_over_noise": float(np.sqrt(found.scale2)),
        "residual_over_noise_of_load": np.sqrt(found.misfit / np.maximum(found.rows, 1)),
        "load_used": [bool(one) for one in use],
        "rejected": list(out),
    }


def _refuse_mistakes(
    chain: Chain,
    setup: LoadingSetup,
    tests: LoadingTests,
    found: Estimate,
    use: Float,
    points_out: int,
    largest_relative_u: float,
) -> None:
    """A mistake that explains a bad fit is an error. Where many loads were put aside, they are looked at with it."""
    points = 0 if tests.targets_mm is None else tests.targets_mm.size / 3
    if points_out > MANY * points or (use == 0).sum() > MANY * len(use):
        found = solve(equations(chain, setup, tests), np.ones(len(use)))
    mistake = explain(chain, setup, tests, found, largest_relative_u)
    if mistake:
        raise InputError(tests.source, mistake)


def _stiffness(
    found: Estimate, covariance: Float, tests: LoadingTests, use: Float, warnings: tuple[str, ...]
) -> JointStiffness:
    """Stiffness as the reciprocal of the compliance.

    The compliance is normal and unbiased, its reciprocal is not: its mean is high by the relative variance (that of the
    residuals, where the loads are better than their stated noise), and its variance has terms of fourth order, which
    count where a joint is known to 10 or 20 % only.
    """
    k = 1 / found.compliance
    relative = covariance * np.outer(k, k)
    r = np.diag(relative)
    fourth = relative * np.outer(1 + 3 * r, 1 + 3 * r) + 2 * relative**2
    values = np.linalg.eigvalsh(np.linalg.inv(relative))
    used = [tests.labels[i] for i in np.flatnonzero(use)]
    return JointStiffness(
        nm_per_rad=k / (1 + r * min(found.scale2, 1.0)),
        covariance=fourth * np.outer(k, k),
        condition_number=float(np.sqrt(values[-1] / values[0])),
        postures=len(set(used)),
        loads=len(used),
        source=tests.source,
        warnings=warnings,
    )


# Pairs of opposite loads: what does not reverse is drift, backlash or friction, not elasticity.

OPPOSITE = 0.05  # of the wrench: how far the two may be from opposite
SURE = 1e-3  # chance that sound pairs are complained of


def opposite_pairs(tests: LoadingTests) -> list[tuple[int, int]]:
    """Loads (i, j) of one posture whose wrenches are opposite; each load in one pair at most."""
    pairs: list[tuple[int, int]] = []
    free = set(range(len(tests.lines)))
    for i in range(len(tests.lines)):
        for j in range(i + 1, len(tests.lines)):
            same = tests.labels[i] == tests.labels[j] and np.abs(tests.joints[i] - tests.joints[j]).max() < 1e-6
            opposed = np.abs(tests.wrench[i] + tests.wrench[j]).max() <= OPPOSITE * np.abs(tests.wrench[i]).max()
            if same and opposed and {i, j} <= free:
                pairs.append((i, j))
                free -= {i, j}
    return pairs


def check_pairs(tests: LoadingTests, eq: Equations, compliance: Float, use: Float, scale2: float) -> tuple[str, ...]:
    """A line for each posture whose opposite loads do not give opposite displacements."""
    covariance = covariances(eq, compliance) * max(scale2, 1.0)
    even = eq.y - eq.a @ compliance - curvature(eq, compliance)
    sums: dict[str, list[tuple[float, int, float]]] = {}
    for i, j in opposite_pairs(tests):
        both = (eq.seen[i] * eq.seen[j] * use[i] * use[j]) > 0
        if not both.any():
            continue
        e = (even[i] + even[j])[both] / 2
        square = e @ np.linalg.solve((covariance[i] + covariance[j])[np.ix_(both, both)] / 4, e)
        sums.setdefault(tests.labels[i], []).append((float(square), int(both.sum()), float(np.linalg.norm(e[:3]))))
    notes = []
    for label, found in sums.items():
        if sum(s for s, _, _ in found) > scipy.special.chdtri(sum(n for _, n, _ in found), SURE / len(sums)):
            most = max(mm for _, _, mm in found)
            notes.append(
                f"posture {label}: opposite loads do not give opposite displacements (up to {most:.3f} mm "
                "remain): drift, backlash or friction beside elasticity"
            )
    return tuple(notes)


# What loading tests must be before and after their equations are solved; each refusal is one line.


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


# The identified stiffness as a chapter of the report.


def stiffness_chapter(found: JointStiffness, labels: tuple[str, ...], residual: Float, used: list[bool]) -> Chapter:
    """Stiffness with its uncertainty, and how each load fits."""
    share = 2 * found.u_nm_per_rad / found.nm_per_rad
    worst = int(np.argmax(share))
    summary = (
        f"Joint stiffness from {found.loads} loads at {found.postures} postures; the least certain is joint "
        f"{worst + 1}, U = {100 * share[worst]:.1f} % of its value (k = 2)"
    )
    rows = [
        (f"{j}", f"{k / 1e6:.4f} ± {2 * u / 1e6:.4f}", f"{100 * (2 * u / k):.1f} %")
        for j, (k, u) in enumerate(zip(found.nm_per_rad, found.u_nm_per_rad, strict=True), 1)
    ]
    text = (
        pieces.table_html(("Joint", "Stiffness ± U, 10⁶ N·m/rad", "U / value"), rows)
        + pieces.note(f"U: expanded uncertainty, U = 2 u. Condition number {found.condition_number:.1f}.")
        + pieces.list_html(found.warnings)
        + pieces.figure_html(
            _picture(labels, residual, used),
            "Residual of each load over its noise",
            "Residual of each load over its standard uncertainty; ×: left out.",
        )
    )
    return Chapter("Joint stiffness", text, summary=summary)


def _picture(labels: tuple[str, ...], residual: Float, used: list[bool]) -> bytes:
    """Residual of each load over its noise, by posture; loads left out as crosses."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(labels))
    with pieces.styled():
        figure = Figure(figsize=(10, 2.8), layout="constrained")
        axes = figure.subplots()
        at, kept = np.arange(1, len(labels) + 1), np.array(used)
        for name in names:
            here = np.array([label == name for label in labels])
            (drawn,) = axes.plot(at[here & kept], residual[here & kept], "o", ms=3, label=f"posture {name}")
            axes.plot(at[here & ~kept], residual[here & ~kept], "x", color=drawn.get_color())
        axes.axhline(1.0, color=pieces.GREY, lw=0.8)
        axes.set(xlabel="load", ylabel="residual / noise")
        axes.set_ylim(bottom=0)
        if len(names) <= 8:
            axes.legend(ncols=8, loc="lower left", bbox_to_anchor=(0.0, 1.0))
        return pieces.svg(figure)


# Tracked points move as one rigid body: a point that does not is a gross error of the tracker.

GROSS = 1e-4  # chance that a sound set of loads loses a point


def check_rigid(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> tuple[LoadingTests, tuple[str, ...]]:
    """The tests without points that contradict the others, and a line on each.

    A load's points are fitted with a small rigid motion (six unknowns). Where the misfit is no chance, the point
    without which the others agree is put aside; where three points disagree and none can be told, all of them are.
    """
    if tests.targets_mm is None:
        return tests, ()
    at = _levers(chain, setup, tests)
    seen = np.isfinite(tests.targets_mm[..., 0])
    moved, notes = tests.targets_mm.copy(), []
    spread = _spread(moved, at, seen, setup.target_noise_mm)
    for i in range(len(moved)):
        for k in _gross(moved[i], at[i], seen[i], setup.target_noise_mm * spread, len(moved)):
            moved[i, k] = np.nan
            notes.append(f"line {tests.lines[i]}: point p{k + 1} does not move with the others: left out")
    if np.isnan(moved).all():
        raise InputError(tests.source, "expected tracked points that move as one rigid body, found none")
    return dataclasses.replace(tests, targets_mm=moved), tuple(notes)


def _levers(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Float:
    """(L, k, 3) from the points' middle to each point, in base axes."""
    assert tests.targets_mm is not None
    count = tests.targets_mm.shape[1]
    if count > len(setup.targets_mm):
        raise InputError(
            tests.source,
            f"expected at most {len(setup.targets_mm)} tracked points: the cell file's "
            f"$.loading.targets_mm places no p{count}",
        )
    rotation = forward_kinematics(chain, tests.joints)[:, None, :3, :3]
    arms = setup.targets_mm[:count] - setup.targets_mm[:count].mean(axis=0)
    return np.asarray((rotation @ arms[:, :, None])[..., 0])


def _misfit(moved: Float, at: Float, use: Bool) -> float:
    """Sum of squares (mm^2) that no small rigid motion explains."""
    x, y, z = at[use].T
    o = np.zeros_like(x)
    turn = np.stack([np.stack([o, z, -y], -1), np.stack([-z, o, x], -1), np.stack([y, -x, o], -1)], 1)
    a = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=2).reshape(-1, 6)
    b = moved[use].reshape(-1)
    return float(np.sum((b - a @ np.linalg.lstsq(a, b, rcond=None)[0]) ** 2))


def _spread(moved: Float, at: Float, seen: Bool, noise_mm: float) -> float:
    """How many times the stated noise most loads show, at least 1."""
    ratios = [
        _misfit(m, a, s) / noise_mm**2 / scipy.special.chdtri(3 * s.sum() - 6, 0.5)
        for m, a, s in zip(moved, at, seen, strict=True)
        if s.sum() >= 3
    ]
    return max(1.0, float(np.sqrt(np.median(ratios)))) if ratios else 1.0


def _gross(moved: Float, at: Float, seen: Bool, noise_mm: float, loads: int) -> list[int]:
    """Points of one load to leave out."""
    use = seen.copy()
    while use.sum() >= 3 and _misfit(moved, at, use) > noise_mm**2 * scipy.special.chdtri(
        3 * use.sum() - 6, GROSS / loads
    ):
        if use.sum() == 3:
            return [int(k) for k in np.flatnonzero(seen)]
        without = []
        for k in np.flatnonzero(use):
            rest = use.copy()
            rest[k] = False
            without.append((_misfit(moved, at, rest), int(k)))
        use[min(without)[1]] = False
    return [int(k) for k in np.flatnonzero(seen & ~use)]
