"""`stiffness.identify`: the joints' stiffness from loading tests."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any

import numpy as np
import scipy
from pydantic import Field

from workbench.api import (
    NO_NAMES,
    UNKNOWN_PART,
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
    PartNames,
    abb_angles,
    forward_kinematics,
    pieces,
    stage,
)
from workbench.plugins.stiffness.beyond_springs import LackOfFit, lack_of_fit
from workbench.plugins.stiffness.equations import Estimate, equations, robust, solve
from workbench.plugins.stiffness.load_checks import (
    check_agreement,
    check_clipped,
    check_filled,
    check_limits,
    check_observed,
    check_pairs,
    check_size,
    check_springs,
    check_stated,
    counted_once,
    explain,
    rounded,
)
from workbench.plugins.stiffness.read import read_loads, stiffness_document
from workbench.plugins.stiffness.values import JointStiffness, LoadingTests

GROSS = 1e-4  # chance that a sound set of loads loses a point


def check_rigid(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> tuple[LoadingTests, tuple[str, ...]]:
    """The tests without points that contradict the others, and a line on each.

    A load's points are fitted with a small rigid motion (six unknowns). Where the misfit is no chance, the point
    without which the others agree is rejected; where three points disagree and none can be told, all of them are.
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


MANY = 0.1  # share of loads or points: where more contradict the rest, it is no gross error here and there


@stage("stiffness.identify")
def identify(
    cell: Cell,
    *,
    loads: InputFile,
    angle_convention: AngleConvention = "abb",
    largest_relative_u: Annotated[float, Field(gt=0, le=1)] = 0.5,
    scale_relative_u: Annotated[
        float,
        Field(ge=0, le=0.2),
    ] = 0.0,
    part: PartNames = NO_NAMES,
) -> tuple[JointStiffness, Chapter, Document]:
    """Identify the joints' stiffness from loads and displacements (the paper's sections 5.2 and 6.2, eq. (24)).

    Weighted least squares for the compliance, with the cell file's noise of displacement and wrench, (27) and (28) put
    right, and the second order of the deflection. Tracked points that leave the rigid body, and loads that contradict
    the rest, are rejected. What six springs do not explain is named and stands in u (docs/stiffness_metrology.md).

    Args:
        cell: the cell; its `loading` says where sensor, tool and targets sit.
        loads: a loads.csv: one row a loading test, wrench and displacement as loaded minus unloaded.
        angle_convention: how the file's joint angles count; the contract has the controller's (abb).
        largest_relative_u: ratio of standard uncertainty to value above which a joint is refused, with the reason.
        scale_relative_u: standard uncertainty of the ratio of force sensor's to tracker's scale, which no load shows.
        part: whose loading tests they are: robot, robot_serial, recorded_at (ISO 8601), operator, for the file and the
            page.

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
    tests = counted_once(read_loads(loads))
    check_clipped(tests)
    tests = dataclasses.replace(tests, joints=abb_angles(tests.joints, angle_convention))
    check_limits(cell.chain, tests, angle_convention)
    found, notes = identify_from(cell.chain, rounded(cell.loading, tests), tests, largest_relative_u, scale_relative_u)
    if cell.joint_stiffness_nm_per_rad is not None:
        check_stated(found, cell.joint_stiffness_nm_per_rad, cell.source, tests)
    chapter = stiffness_chapter(
        found, tests.labels, notes["residual_over_noise_of_load"], notes["load_used"], scale_relative_u
    )
    who = UNKNOWN_PART.with_names(part)
    chapter = dataclasses.replace(chapter, part=who, about="instruments")
    return found, chapter, stiffness_document(found, part=dataclasses.asdict(who), **notes)


def identify_from(
    chain: Chain,
    setup: LoadingSetup,
    tests: LoadingTests,
    largest_relative_u: float = 0.5,
    scale_relative_u: float = 0.0,
) -> tuple[JointStiffness, dict[str, Any]]:
    """Stiffness from tests in memory, their angles the controller's; and what the result file adds to it."""
    check_filled(tests)
    sound, points_out = check_rigid(chain, setup, tests)
    eq = equations(chain, setup, sound)
    found, use = robust(eq)
    _refuse_mistakes(chain, setup, tests, found, use, len(points_out), largest_relative_u)
    check_agreement(tests, found, use)
    lack = lack_of_fit(chain, setup, sound, eq, found, use)
    covariance = found.covariance * max(lack.widened, _surely_more(found))
    by_noise = dataclasses.replace(found, covariance=covariance, scale2=min(found.scale2, 1.0))
    scaled = scale_relative_u * found.compliance
    systematic = np.outer(lack.change, lack.change) + np.outer(scaled, scaled)
    known = dataclasses.replace(by_noise, covariance=covariance + systematic)
    check_observed(by_noise, eq, chain, setup, sound, largest_relative_u, lack)
    check_springs(known, lack, tests, largest_relative_u)
    check_size(found, tests)
    out = (
        *points_out,
        *(f"line {tests.lines[i]}: this load contradicts the others: left out" for i in np.flatnonzero(use == 0)),
    )
    warnings = [*tests.warnings, *out, *check_pairs(sound, eq, found.compliance, use, found.scale2)]
    warnings += lack_in_words(found, lack, covariance)
    return _stiffness(known, covariance, sound, use, tuple(warnings)), {
        "joint_compliance_rad_per_nm": found.compliance,
        "compliance_covariance": known.covariance,
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
    """A mistake that explains a bad fit is an error. Where many loads were rejected, they are looked at with it."""
    points = 0 if tests.targets_mm is None else tests.targets_mm.size / 3
    if points_out > MANY * points or (use == 0).sum() > MANY * len(use):
        found = solve(equations(chain, setup, tests), np.ones(len(use)))
    mistake = explain(chain, setup, tests, found, largest_relative_u)
    if mistake:
        raise InputError(tests.source, mistake)


def _surely_more(found: Estimate) -> float:
    """Variance of the residuals over the noise's, where that is more than chance; else 1."""
    noisy = found.scale2 > scipy.special.chdtri(found.freedom, 0.001) / found.freedom
    return found.scale2 if noisy else 1.0


def lack_in_words(found: Estimate, lack: LackOfFit, covariance: Float) -> list[str]:
    """What stands in u beside the cell's noise, a line each."""
    times = np.sqrt(covariance[0, 0] / found.covariance[0, 0])
    lines = []
    if times > 1.0:
        lines.append(
            f"residuals are {np.sqrt(found.scale2):.2f} times what the cell's noise predicts: "
            f"uncertainties are widened {times:.2f} times"
        )
    if lack.causes:
        share = np.abs(lack.change / found.compliance)
        joint = int(np.argmax(share))
        lines.append(
            f"six springs alone do not explain the displacements; what would: {lack.causes}. That would "
            f"change joint {joint + 1} by {100 * share[joint]:.2g} %, and stands in u"
        )
    return lines


def _stiffness(
    known: Estimate, by_noise: Float, tests: LoadingTests, use: Float, warnings: tuple[str, ...]
) -> JointStiffness:
    """Stiffness as the reciprocal of the compliance; `by_noise` (6, 6) is what of its covariance is random.

    The compliance is normal and unbiased, its reciprocal is not: its mean is high by the relative variance (that of the
    residuals, where the loads are better than their stated noise), and its variance has terms of fourth order, which
    count where a joint is known to 10 or 20 % only.
    """
    k = 1 / known.compliance
    relative = known.covariance * np.outer(k, k)
    r = np.diag(by_noise) * k**2
    fourth = relative * np.outer(1 + 3 * r, 1 + 3 * r) + 2 * relative**2
    values = np.linalg.eigvalsh(np.linalg.inv(relative))
    used = [tests.labels[i] for i in np.flatnonzero(use)]
    return JointStiffness(
        nm_per_rad=k / (1 + r * known.scale2),
        covariance=fourth * np.outer(k, k),
        condition_number=float(np.sqrt(values[-1] / values[0])),
        postures=len(set(used)),
        loads=len(used),
        source=tests.source,
        warnings=warnings,
    )


# The identified stiffness as a chapter of the report.


def stiffness_chapter(
    found: JointStiffness, labels: tuple[str, ...], residual: Float, used: list[bool], scale_relative_u: float
) -> Chapter:
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
        + pieces.note(
            f"U: expanded uncertainty, U = 2 u. Condition number {found.condition_number:.1f}. Scale of force sensor "
            + (
                f"against tracker: u = {100 * scale_relative_u:.2g} %, in U."
                if scale_relative_u
                else "and tracker: not in U, no loading test shows it (scale_relative_u declares it)."
            )
        )
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
