"""What calibrations from tables share: poses in them, what their fit says, what the result is good for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy

from workbench.api import (
    DEG,
    Chapter,
    Document,
    Float,
    InputError,
    Int,
    Part,
    RobotFile,
    Shaped,
    ToolFile,
    TurntableFile,
    estimator,
    pieces,
    pose_from,
    result_file,
    rotation_from_quaternion,
)
from workbench.plugins.csv_table import Table

POSE = ("x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz")  # a flange in the base
JOINTS = tuple(f"q{k}_deg" for k in range(1, 7))
ENOUGH = 0.5  # of the tolerance of the root face, that one link of the chain may take
NOISY = 2.0  # misfit that is told
MOST_MISFIT = 100.0  # residuals of ten times the stated noise
TOO_NEAR = 15.0  # times nearer to each other than the noise says: a length in inches is 25.4 times too small
CHANCE = 0.01  # that what is at rest counts as moving
LENGTHS = 1e-4  # of a robot, off by so much, for its size
LONGER = f"a robot whose lengths are off by {LENGTHS:g}"
NOTHING = 0.1  # standard uncertainties, that are not worth a word
MOST_STEPS = 40  # that are tried


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """How what should be at rest moves over n rows, or another error of a few unknowns that rows may tell."""

    change: Shaped[Float, "n 3 q"]  # of the rows' places by each of its unknowns, mm: the whole way along an axis
    words: str  # with the size in mm and its direction left open
    share: float = 0.0  # mean square of the way at a time as likely as any
    among: int = 1  # how many of its kind are tried
    ask: str = "did they, the base or the tool move or warm up?"

    @classmethod
    def of(cls, way: Float, words: str, share: float, among: int = 1) -> Course:
        """Along any axis; way (n,): -0.5 to 0.5."""
        return cls(way[:, None, None] * np.eye(3), words, share, among)


def even(what: str, lines: Iterable[int]) -> Course:
    """A drift over the rows, from the first to the last."""
    time = np.argsort(np.argsort(np.array(lines)))
    words = f"{what} drift by {{:.2f}} mm{{}} from the first row to the last"
    return Course.of(time / (len(time) - 1) - 0.5, words, 1.0 / 12.0)


def ways(what: str, lines: tuple[int, ...], **by: Float) -> list[Course]:
    """An even drift, and steps after a row or beyond a value (n,) of one of `by`."""
    cuts = [
        (np.where(value > cut, 0.5, -0.5), f"{what} shift by {{:.2f}} mm{{}} after {name} {cut:g}")
        for name, value in {"line": np.array(lines), **by}.items()
        for cut in np.unique(value)[1:-2][:: 1 + len(value) // MOST_STEPS]
    ]
    return [even(what, lines), *(Course.of(way, words, 0.25, len(cuts)) for way, words in cuts)]


def likeliest(found: estimator.Fit[Any], courses: Iterable[Course], along: Float | None = None) -> Course | None:
    """The likeliest of what may move, along directions (3, d) of its unknowns; None: all is at rest."""

    def chance(one: Course) -> float:
        size, covariance = found.tested(one.change if along is None else one.change @ along)
        return one.among * float(scipy.special.chdtrc(len(size), size @ np.linalg.solve(covariance, size)))

    least, best = min(((chance(one), one) for one in courses), key=lambda pair: pair[0])
    return best if least < CHANCE else None


def not_included(
    found: estimator.Fit[Any], causes: dict[str, Float], sized: Callable[[Float], tuple[str, float]]
) -> list[str]:
    """What errors that no unknown holds would change, in words, that which changes most first.

    causes: by their words, with their size, how each changes the rows' values (n, d).
    sized: of a change (P,) of the unknowns what it is in words, and how many standard uncertainties.
    """
    moved = found.carried(np.stack(list(causes.values()), axis=2)).T if causes else ()
    sizes = [(*sized(one), cause) for cause, one in zip(causes, moved, strict=True)]
    ordered = sorted(sizes, key=lambda one: -one[1])
    return [f"{cause}: {words}, {times:.2g} u" for words, times, cause in ordered if times > NOTHING]


def poses(table: Table) -> Float:
    """Poses (n, 4, 4) from the columns POSE; a quaternion of norm 1 within 1e-3 is normalised, another refused."""
    pose = table.numbers(POSE)
    norm = np.linalg.norm(pose[:, 3:], axis=1)
    for line, n in zip(table.lines, norm, strict=True):
        if not abs(n - 1.0) <= 1e-3:
            raise InputError(
                f"{table.path}: line {line}", f"expected a quaternion of norm 1 within 1e-3, found {n:.4g}"
            )
    return pose_from(rotation_from_quaternion(pose[:, 3:] / norm[:, None]), pose[:, :3])


def check_misfit(found: estimator.Fit[Any], labels: estimator.Labels) -> None:
    """Refuse residuals so large that neither noise nor a robot that errs a little makes them.

    Too many rows then lie too far from what fits them best for any to be called a blunder.
    """
    if found.freedom >= estimator.LEAST_FREEDOM and found.misfit > MOST_MISFIT:
        raise estimator.contradictory(found.misfit, labels)


def enough(
    u_mm: float,
    bevel_deg: float,
    root_tolerance_mm: float,
    what: str,
    else_: str,
    turn: tuple[float, float] | None = None,
    but: Iterable[str] = (),
) -> tuple[bool, str]:
    """Whether an uncertainty across the bevel serves a tolerance of the root face, and the sentence that says so.

    A tool that stands off by u along the bevel's normal moves the root's end by u / sin(bevel). Uncertainties add as
    squares: one that takes up to half of the tolerance leaves 87 % of it to all others. `turn`: likewise, the
    uncertainty of a direction and the tolerance of the bevel angle, both in degrees. `but`: why it does not even so.
    """
    expanded = 2.0 * u_mm / math.sin(bevel_deg * DEG)
    good = expanded <= ENOUGH * root_tolerance_mm
    takes = f"{what} alone takes U = {expanded:.3f} mm of a root face tolerance of ± {root_tolerance_mm:g} mm"
    if turn is not None:
        good = good and 2.0 * turn[0] <= ENOUGH * turn[1]
        takes += f" and {2.0 * turn[0]:.3f} deg of a bevel tolerance of ± {turn[1]:g} deg"
    verdict = f"{takes}: {'good enough' if good else f'not good enough, more than half of it; {else_}'}"
    return bool(good and not but), "; not good enough: ".join((verdict, *but))


def noisy(found: estimator.Fit[Any], what: str, ask: str) -> tuple[str, ...]:
    """A warning where the residuals are larger than the stated noise, or smaller by far."""
    if found.freedom < estimator.LEAST_FREEDOM:
        return ()
    if found.misfit < TOO_NEAR**-2:
        return (
            f"{what} lie more than {TOO_NEAR:g} times nearer to each other than the stated noise says: are positions "
            "in mm, and is each one measured by itself?",
        )
    if found.misfit <= NOISY:
        return ()
    return (
        f"{what} lie {math.sqrt(found.misfit):.1f} times as far apart as the stated noise says: the uncertainties "
        f"hold that as chance, not as an error tied to posture or angle; {ask}",
    )


def refuse_open(where: str, what: str, u_mm: float, way: Float, frame: str, most_mm: float, ask: Iterable[str]) -> None:
    """Refuse a place whose greatest standard uncertainty, along `way` (3,), is beyond a limit; or is not finite."""
    if u_mm <= most_mm:
        return
    size = "nothing determines" if u_mm > 1e3 else f"u = {u_mm:.3g} mm of"
    axes = ", ".join(f"{v:+.2f}" for v in way)
    said = f"{size} {what} along ({axes}) in the {frame}, expected at most {most_mm:g} mm: {'; '.join(ask)}"
    raise InputError(where, said)


def results(
    file: type[RobotFile | ToolFile | TurntableFile], title: str, who: Part, content: dict[str, Any], html: str
) -> tuple[Document, Chapter]:
    """A calibration's file and the report's chapter; `content`: what was found, with what `fit_fields` says."""
    warnings = (*content["warnings"], *content.get("left_as_built", ()))
    html += left_out_html(content.get("not_included", ()))
    chapter = Chapter(title, html, summary=content["verdict"], part=who, about="instruments", warnings=warnings)
    return result_file(file.NAME, {"part": asdict(who), **content}), chapter


def left_out_html(said: Iterable[str]) -> str:
    """What u does not hold, for the report."""
    return pieces.list_html([f"Not included: {one}" for one in said])


def fit_fields(
    found: estimator.Fit[Any],
    left_out: dict[int, str],
    verdict: tuple[bool, str],
    warnings: tuple[str, ...],
    name: str = "line",
) -> dict[str, Any]:
    """What every result file says of its fit; `name`: what a number of `left_out` counts."""
    return {
        "misfit": found.misfit,
        "left_out": [{name: number, "cause": cause} for number, cause in left_out.items()],
        "good_enough": verdict[0],
        "verdict": verdict[1],
        "warnings": warnings,
    }


def rms_mm(residual: Float) -> float:
    """Root mean square of lengths (n, k)."""
    return float(np.sqrt(np.mean((residual**2).sum(axis=1))))


def sentence(words: str) -> str:
    """Words as a sentence of the report."""
    return f"{words[:1].upper()}{words[1:]}."


def fit_words(found: estimator.Fit[Any]) -> str:
    """How well a fit agrees with its noise, for the report."""
    return f"Chi-square over degrees of freedom {found.misfit:.2f} on {found.freedom}."


def by_point(change: Float, which: Int, count: int) -> Float:
    """Columns (n, d, 3 count) of points, of which an observation shows one, `which` (n,), by its change (n, d, 3)."""
    columns = np.einsum("ndj,nk->ndkj", change, np.eye(count)[which])
    return np.reshape(columns, (*change.shape[:2], -1))


def lever_noise(lever: Float, sigma_mm: float, sigma: float) -> Float:
    """Covariance (n, 3, 3) of points at the ends of levers (n, 3): of their place, and of an orientation (rad)."""
    across = (lever**2).sum(axis=1)[:, None, None] * np.eye(3) - lever[:, :, None] * lever[:, None, :]
    return np.asarray(sigma_mm**2 * np.eye(3) + sigma**2 * across)
