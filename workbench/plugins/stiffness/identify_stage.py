"""`stiffness.identify`: the joints' stiffness from loading tests."""

from __future__ import annotations

from dataclasses import asdict, replace
from itertools import cycle
from typing import Any

import numpy as np
import scipy

from workbench.api import (
    NO_NAMES,
    UNKNOWN_PART,
    AngleConvention,
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
    estimator,
    pieces,
    plot,
    stage,
)
from workbench.plugins.ranges import AsBuiltU, RelativeU, ScaleU
from workbench.plugins.stiffness.beyond_springs import with_causes
from workbench.plugins.stiffness.equations import Loading, equations
from workbench.plugins.stiffness.load_checks import (
    check_clipped,
    check_filled,
    check_limits,
    check_observed,
    check_size,
    check_springs,
    check_stated,
    counted_once,
    explain,
    rounded,
)
from workbench.plugins.stiffness.read_stage import read_loads, stiffness_document
from workbench.plugins.stiffness.values import JointStiffness, LoadingTests

MANY = 0.1  # share of what was seen: where more contradicts the rest, it is no gross error here and there
ASKED = "are the joint angles those at which the loads were put on?"
LITTLE = 1e-3  # share of a joint's compliance that is no change


@stage("stiffness.identify")
def identify(
    cell: Cell,
    *,
    loads: InputFile,
    angle_convention: AngleConvention = "abb",
    largest_relative_u: RelativeU = 0.5,
    scale_relative_u: ScaleU = 0.02,
    as_built_u: AsBuiltU = 1.0,
    part: PartNames = NO_NAMES,
) -> tuple[JointStiffness, Chapter, Document]:
    """Identify the joints' stiffness from loads and displacements (the paper's sections 5.2 and 6.2, eq. (24)).

    Weighted least squares for the compliance, (27) and (28) corrected, springs and loads in balance. Contradictory
    points and loads are rejected; what six springs do not explain is in u (docs/stiffness_metrology.md).

    Args:
        cell: the cell; its `loading` says where sensor, tool and targets sit.
        loads: a loads.csv: one row a loading test, loaded minus unloaded.
        angle_convention: as in `stiffness.deflection`.
        largest_relative_u: largest accepted ratio of standard uncertainty to stiffness of a joint.
        scale_relative_u: standard uncertainty of the ratio of the force sensor's scale to the tracker's, which no load
            shows.
        as_built_u: factor on the standard uncertainties of joint zeros, sensor, targets and links
            (docs/stiffness_metrology.md); 0: all stand as stated.
        part: robot, robot_serial, recorded_at (ISO 8601), operator, for the file and the page.

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
    tests = replace(tests, joints=abb_angles(tests.joints, angle_convention))
    check_limits(cell.chain, tests, angle_convention)
    setup = rounded(cell.loading, tests)
    found, notes = identify_from(cell.chain, setup, tests, largest_relative_u, scale_relative_u, as_built_u)
    if cell.joint_stiffness_nm_per_rad is not None:
        check_stated(found, cell.joint_stiffness_nm_per_rad, cell.source, tests)
    chapter = stiffness_chapter(found, tests.labels, notes)
    who = UNKNOWN_PART.with_names(part)
    chapter = replace(chapter, part=who, about="instruments")
    return found, chapter, stiffness_document(found, part=asdict(who), **notes)


def identify_from(
    chain: Chain,
    setup: LoadingSetup,
    tests: LoadingTests,
    largest_relative_u: float = 0.5,
    scale_relative_u: float = 0.02,
    as_built_u: float = 1.0,
) -> tuple[JointStiffness, dict[str, Any]]:
    """Stiffness from tests in memory, their angles the controller's; and what the result file adds to it."""
    check_filled(tests)
    if tests.points > len(setup.targets_mm):
        why = f"the cell file's $.loading.targets_mm places no p{tests.points}"
        raise InputError(tests.source, f"expected at most {len(setup.targets_mm)} tracked points: {why}")
    eq = equations(chain, setup, tests)
    plain = Loading(eq)
    labels = estimator.Labels(tests.source, tuple(range(len(plain.load))), ask=ASKED)
    refused: InputError | None = None
    try:
        springs, left_out = estimator.without_blunders(plain, plain.fit().at, labels)
    except InputError as error:
        springs, left_out, refused = plain.fit(), {}, error
    doubtful = len(left_out) > MANY * len(plain.load)
    mistake = explain(chain, setup, tests, plain.fit() if doubtful else springs, largest_relative_u)
    if mistake:
        raise InputError(tests.source, mistake)
    if refused is not None:
        raise refused
    loading, found, lack = with_causes(chain, setup, tests, springs, labels, as_built_u)
    noisy = found.freedom > 0 and found.chi2 > scipy.special.chdtri(found.freedom, 0.001)  # more than by chance
    compliance, times = found.at[:6], max(lack.widened, found.misfit if noisy else 1.0)
    prior = found.rows.prior
    covariance = estimator.inverse_information((found.information - prior) / times + prior)[:6, :6]
    scaled = scale_relative_u * compliance
    known = covariance + np.outer(lack.change, lack.change) + np.outer(scaled, scaled)
    check_observed(compliance, covariance, eq, tests, largest_relative_u, lack)
    check_springs(compliance, known, lack, tests, largest_relative_u)
    check_size(compliance, tests)
    out = _left_out(tests, loading, found)
    warnings = [*tests.warnings, *out]
    if times > 1.0:
        warnings.append(
            f"residuals are {np.sqrt(found.misfit):.2f} times what the cell's noise predicts: "
            f"uncertainties are widened {np.sqrt(times):.2f} times"
        )
    if lack.causes:
        share = np.abs(lack.change / compliance)
        joint = int(share.argmax())
        changes = f"change joint {joint + 1} by {100 * share[joint]:.2g} %, and stands in u"
        warnings.append(
            f"six springs alone do not explain the displacements; what would: {lack.causes}. That would "
            + (changes if share[joint] > LITTLE else "change no joint")
        )
    of_gain = 0.01 * compliance / estimator.standard_u(covariance)
    gain = (
        "the force sensor's gain against the tracker's scale: 1 % of it changes every joint by 1 % "
        f"({of_gain.max():.2g} u of joint {of_gain.argmax() + 1}); no residual shows it, scale_relative_u declares it"
    )
    use = np.isin(np.arange(len(eq.y)), loading.load[found.used])
    labels_used = [tests.labels[i] for i in np.flatnonzero(use)]
    values, spread, condition = reciprocal(compliance, known, covariance, found.misfit)
    made = JointStiffness(
        nm_per_rad=values,
        covariance=spread,
        condition_number=condition,
        postures=len(set(labels_used)),
        loads=len(labels_used),
        source=tests.source,
        warnings=tuple(warnings),
    )
    return made, {
        "joint_compliance_rad_per_nm": compliance,
        "compliance_covariance": known,
        "residual_over_noise": np.sqrt(found.misfit),
        "residual_over_noise_of_load": np.sqrt(loading.misfits(found.rows)),
        "load_used": use.tolist(),
        "rejected": out,
        "not_included": [*([] if scale_relative_u else [gain]), *lack.hidden],
    }


def _left_out(tests: LoadingTests, loading: Loading, found: estimator.Fit[Float]) -> list[str]:
    """A line on each load, and each point of one, that contradicts the others."""
    lines = []
    for i in np.unique(loading.load[~found.used]):
        points = loading.point[(loading.load == i) & ~found.used]
        if len(points) == (loading.load == i).sum():
            lines.append(f"line {tests.lines[i]}: this load contradicts the others: left out")
        else:
            names = " and ".join(f"p{k + 1}" for k in points)
            verb = "does" if len(points) == 1 else "do"
            lines.append(f"line {tests.lines[i]}: point {names} {verb} not move with the others: left out")
    return lines


def reciprocal(compliance: Float, covariance: Float, by_noise: Float, misfit: float) -> tuple[Float, Float, float]:
    """Stiffness (6,) with its covariance (6, 6), of compliances; and the condition number of the weighted problem.

    The compliance is normal and unbiased, its reciprocal is not: its mean is high by the relative variance of what is
    random (`by_noise` (6, 6); that of the residuals, where the loads are better than their stated noise), and its
    variance has terms of fourth order, which count where a joint is known to 10 or 20 % only.
    """
    k = 1 / compliance
    relative = covariance * np.outer(k, k)
    r = np.diag(by_noise) * k**2
    fourth = relative * np.outer(1 + 3 * r, 1 + 3 * r) + 2 * relative**2
    values = np.linalg.eigvalsh(np.linalg.inv(relative))
    return k / (1 + r * min(misfit, 1.0)), fourth * np.outer(k, k), np.sqrt(values[-1] / values[0])


# The identified stiffness as a chapter of the report.


def stiffness_chapter(found: JointStiffness, labels: tuple[str, ...], notes: dict[str, Any]) -> Chapter:
    """Stiffness with its uncertainty, what that does not hold, and how each load fits; `notes`: of the result file."""
    share = 2 * found.u_nm_per_rad / found.nm_per_rad
    worst = int(share.argmax())
    summary = (
        f"Joint stiffness from {found.loads} loads at {found.postures} postures; the least certain is joint "
        f"{worst + 1}, U = {100 * share[worst]:.1f} % of its value (k = 2)"
    )
    rows = [
        (f"{j}", f"{k / 1e6:.4f} ± {2 * u / 1e6:.4f}", f"{100 * (2 * u / k):.1f} %")
        for j, (k, u) in enumerate(zip(found.nm_per_rad, found.u_nm_per_rad, strict=True), 1)
    ]
    names = list(dict.fromkeys(labels))
    key = (
        zip(pieces.SERIES, (f"posture {name}" for name in names), strict=False)
        if len(names) <= len(pieces.SERIES)
        else ()
    )
    text = (
        pieces.table_html(("Joint", "Stiffness ± U, 10⁶ N·m/rad", "U / value"), rows)
        + pieces.note(f"U: expanded uncertainty, U = 2 u. Condition number {found.condition_number:.1f}. Not in U is:")
        + pieces.list_html(notes["not_included"])
        + pieces.list_html(found.warnings)
        + pieces.figure_html(
            _picture(labels, notes["residual_over_noise_of_load"], notes["load_used"]),
            "Residual of each load over its noise",
            "Residual of each load over its standard uncertainty, a colour a posture; ×: left out.",
            key,
        )
    )
    return Chapter("Joint stiffness", text, summary=summary)


def _picture(labels: tuple[str, ...], residual: Float, used: list[bool]) -> bytes:
    """Residual of each load over its noise, by posture; loads left out as crosses."""
    figure = plot.Figure((10.0, 2.8))
    axes = figure.add_axes((0.06, 0.2, 0.92, 0.66))
    at, kept = np.arange(1, len(labels) + 1), np.array(used)
    for name, colour in zip(dict.fromkeys(labels), cycle(pieces.SERIES), strict=False):
        here = np.array([label == name for label in labels])
        axes.points(at[here & kept], residual[here & kept], "o", color=colour, markersize=3.0)
        axes.points(at[here & ~kept], residual[here & ~kept], "x", color=colour)
    axes.axhline(1.0, color=pieces.GREY, linewidth=0.8)
    axes.set(xlabel="load", ylabel="residual / noise", ylim=(0.0, None))
    return figure.svg()
