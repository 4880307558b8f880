"""Calibrations of other instruments by formula, against the truth: robots by a tracker or a sphere, a fixed part."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2

from bench.calibration import arm, faces
from bench.metrology.study import COVERAGE, HEAD, Condition, Row, Study, marked
from workbench.plugins.calibration import hand_eye_faces
from workbench.units import Float

FACES = {"edge": 2, "plane": 1, "points": 0}  # faces in view; of a tracker's points none
CONDITIONS = {"arm_tracker": arm.one_tracked, "arm_sphere": arm.one_sphere} | dict.fromkeys(FACES)
RATIO_GOAL = 1.1  # of the errors over their bound


def measure(condition: str, seed: int) -> Row:
    """Errors of the parameters by their stated u and by their bound, and all together by the stated covariance."""
    if condition in FACES:
        rng = np.random.default_rng(seed)
        made = faces.tracked(rng, 0.025) if condition == "points" else faces.still(rng, 16, FACES[condition])
        eye = hand_eye_faces(made, target=condition, max_u_mm=3.0)[0]  # type: ignore[arg-type]
        assert eye.covariance is not None
        error, covariance, bound = faces.off(eye), eye.covariance, None
    else:
        error, covariance, bound = CONDITIONS[condition](seed)
    u = np.sqrt(np.diagonal(covariance))
    row: Row = {"z": (error / u).tolist()}
    row["nees"] = float(error @ np.linalg.solve(covariance, error))  # chi-square of as many as there are parameters
    row["covered"] = bool(row["nees"] < chi2.ppf(0.95, len(error)))
    if bound is not None:
        lowest = np.sqrt(np.diagonal(bound))
        row |= {"over_bound": (error / lowest).tolist(), "stated": (u / lowest).tolist()}
    return row


def _of_each(c: Condition, name: str) -> Float:
    """RMS of each parameter over the trials."""
    return np.asarray(np.sqrt(np.mean(np.array([row[name] for row in c.good]) ** 2, axis=0)))


def _beside_bound(c: Condition, name: str, goal: float | None = None) -> str:
    if not c.values(name).size:
        return ""
    each = _of_each(c, name)
    return f"{marked(c.rms(name), goal)}: {each.min():.2f} to {each.max():.2f}"


def goals(c: Condition) -> Iterator[tuple[bool, str]]:
    refused = len(c.having("refused"))
    yield refused > 0, f"{refused} refused"
    yield c.rms("over_bound") > RATIO_GOAL, "errors over their bound"
    yield c.share("covered").outside(*COVERAGE), "coverage of the ellipsoid"


STUDY = Study(
    conditions=tuple(CONDITIONS),
    parts=24,
    page="calibration_metrology.md",
    measure=measure,
    goals=goals,
    tables=(
        (
            "Errors beside their bound and their stated u",
            (
                *HEAD,
                ("parameters", lambda c: len(c.good[0]["z"])),
                ("RMSE / bound: all, each", lambda c: _beside_bound(c, "over_bound", RATIO_GOAL)),
                ("stated u / bound", lambda c: _beside_bound(c, "stated")),
                ("within 2u, %", lambda c: f"{100 * np.mean(np.abs(c.values('z')) <= 2):.1f}"),
                ("ellipsoid covers, %", lambda c: c.share("covered").beside(COVERAGE)),
            ),
            lambda c: bool(c.good),
        ),
    ),
)
