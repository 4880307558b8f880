"""What six springs do not explain in loading tests: a lack of fit, in u and with the cause that fits it best.

Residuals that are as the noise predicts in size may still follow the loads: a sensor that stands elsewhere, a base that
gives, a force that is scaled. Each *cause* is a direction d in which the residuals would lie; it is found where they do
by more than chance (docs/stiffness_metrology.md, eq. (L1) to (L3)).
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import scipy

from workbench.api import DEG, Chain, Float, LoadingSetup, Shaped, estimator, forward_kinematics
from workbench.plugins.stiffness.equations import Loading, equations
from workbench.plugins.stiffness.values import LoadingTests

SURE_SIGMAS = 5.0  # of a cause: of 40 causes one in 40,000 sound sets of loads has one
MOST_CAUSES, TOLD = 8, 3
CHANCE = 1e-3  # that sound loads count as lacking fit
RANK = 1e-6  # singular values of the wrenches below this share are none
STEP = 1e-3  # of each cause's unit, for its direction
FEW = 4  # loads of a posture, from which on it may be off by itself
AXES = "xyz"


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """What the residuals say beyond noise."""

    causes: str  # in words, the surest first; empty: none
    change: Shaped[Float, " 6"]  # rad/Nm, by which the compliance would change if the causes were put right
    widened: float  # variance of the residuals that follow the loads, over the noise's; at least 1
    hidden: tuple[str, ...]  # what an error that the residuals do not show would change, with its size


@dataclass(frozen=True, slots=True)
class Cause:
    """Something that is not as the cell file and the loads say, in units of `unit`."""

    words: str  # "{0}" is replaced by its size
    unit: float  # what 1 of `words` is in the units of `changed`
    of_tests: dict[str, Float] = field(default_factory=dict)  # what 1 of `unit` adds to their fields
    of_setup: dict[str, Float] = field(default_factory=dict)
    hidden: tuple[str, str, str] | None = None  # where it may not show: its kind, 1 of it in words, the unit


def lack_of_fit(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, loading: Loading, found: estimator.Fit[Float]
) -> LackOfFit:
    """Causes that the residuals show, what they do to the compliance, and how much else follows the loads."""
    eq = loading.eq  # a direction made of what was measured would share its noise
    modelled = replace(tests, moved=np.where(eq.seen, eq.y - eq.residual(found.at), np.nan))
    causes = list(_causes(chain, setup, modelled))
    here = equations(chain, setup, modelled).residual(found.at)
    directions = []  # (n, d) each: by how much the residuals would be smaller if a cause of size 1 were put right
    for cause in causes:
        other = (_changed(setup, cause.of_setup, cause.unit), _changed(modelled, cause.of_tests, cause.unit))
        directions.append(loading.observed(here - equations(chain, *other).residual(found.at)) / STEP)
    columns = np.stack([*np.moveaxis(found.rows.jacobian, 2, 0), *directions, found.rows.residual], axis=2)
    whole = found.rows.only(found.used).product(columns[found.used])
    repeated, linear = _repeated(tests, loading, found, columns)
    scale = np.append(_scale(whole)[:-1], 1.0)
    whole, repeated = (scale[:, None] * one * scale for one in (whole, repeated))
    others = float(found.rows.values[found.used].sum()) - linear
    taken, told = list(range(6)), list[str]()
    while len(told) < MOST_CAUSES:
        left = _without(whole, taken)
        noise2 = max(_without(repeated, taken)[-1, -1] / others, 1.0) if others > 0 else 1.0
        size, push = np.diagonal(left)[6:-1], left[6:-1, -1]
        gain = np.where(size > RANK, push**2 / np.maximum(size, RANK), 0.0) / noise2
        gain[np.array(taken[6:], int) - 6] = 0.0
        best = int(np.argmax(gain))
        if gain[best] < SURE_SIGMAS**2:
            break
        value = push[best] / size[best] * scale[6 + best]
        told.append(f"{causes[best].words.format(f'{value:+.3g}')} ({np.sqrt(gain[best]):.0f} standard uncertainties)")
        taken.append(6 + best)
    solved = scale[taken] * (_inverse(whole[np.ix_(taken, taken)]) @ whole[taken, -1])
    lacking = (_without(whole, taken) - _without(repeated, taken))[-1, -1]
    freedom = linear - len(taken)
    chance = freedom < 1 or lacking < scipy.special.chdtri(freedom, CHANCE)
    untold = [k for k in range(6, len(whole) - 1) if k not in taken]
    changes = (scale[:6, None] * _inverse(whole[:6, :6]) @ whole[:6, untold]) / scale[untold]
    left = np.diagonal(_without(whole, list(range(6))))[untold]
    shown2 = np.divide(
        SURE_SIGMAS**2 * noise2 * scale[untold] ** 2, left, out=np.full(len(left), np.inf), where=left > RANK
    )
    more = [f"and {len(told) - TOLD} more"] if len(told) > TOLD else []
    return LackOfFit(
        "; ".join([*told[:TOLD], *more]),
        np.asarray(solved[:6]),
        1.0 if chance else lacking / freedom,
        _hidden([causes[k - 6] for k in untold], found, changes.T, np.sqrt(shown2)),
    )


def _hidden(causes: list[Cause], found: estimator.Fit[Float], changes: Float, shown: Float) -> tuple[str, ...]:
    """Of each kind of cause the one that changes a joint most before the residuals show it, by `SURE_SIGMAS`.

    changes (m, 6): rad/Nm for each unit of a cause; shown (m,): its size from which the residuals show it.
    """
    u, worst = np.sqrt(np.diag(found.covariance)), dict[str, tuple[float, str]]()
    for cause, change, size in zip(causes, changes, shown, strict=True):
        if cause.hidden is None:
            continue
        kind, which, unit = cause.hidden
        joint = int(np.argmax(np.abs(change) / u))
        share, times = 100.0 * abs(change[joint] / found.at[joint]), abs(change[joint]) / u[joint]
        words = f"{kind}: {which} changes joint {joint + 1} by {share:.2g} % ({times:.2g} u); "
        words += f"the residuals show {size:.2g} {unit}" if np.isfinite(size) else "no residual shows it"
        worst[kind] = max(worst.get(kind, (0.0, "")), (times * size, words))
    return tuple(words for _, words in worst.values())


_inverse = functools.partial(np.linalg.pinv, rcond=RANK, hermitian=True)  # none along what columns do not hold
Changed = TypeVar("Changed", LoadingSetup, LoadingTests)


def _changed(one: Changed, by: dict[str, Float], unit: float) -> Changed:
    """With STEP units of a cause in it."""
    return replace(one, **{name: getattr(one, name) + STEP * unit * change for name, change in by.items()})


def _scale(products: Float) -> Float:
    """What makes columns (c,) with these products of length 1; 0 of one that is nothing, as of a joint never turned."""
    square = np.diagonal(products)
    return np.divide(1.0, np.sqrt(square), out=np.zeros_like(square), where=square > 0.0)


def _without(products: Float, taken: list[int]) -> Float:
    """Products (c, c) of columns after what the columns `taken` explain of them."""
    across = products[:, taken]
    return np.asarray(products - across @ _inverse(products[np.ix_(taken, taken)]) @ across.T)


def _repeated(tests: LoadingTests, loading: Loading, found: estimator.Fit[Float], columns: Float) -> tuple[Float, int]:
    """Products of the columns (c, c) without all that is linear in the wrench at its posture, and how much that is."""
    products, rank = np.zeros((columns.shape[2],) * 2), 0
    scale = np.maximum(np.abs(tests.wrench).max(axis=0), 1e-12)
    postures = np.unique(np.round(tests.joints, 9), axis=0, return_inverse=True)[1].reshape(-1)
    for posture in np.unique(postures[loading.load[found.used]]):
        here = found.used & (postures[loading.load] == posture)
        loads, load = np.unique(loading.load[here], return_inverse=True)
        u, s, _ = np.linalg.svd(tests.wrench[loads] / scale, full_matrices=False)
        basis = u[load][:, s > RANK * s[0]]
        points, point = np.unique(loading.point[here], return_inverse=True)
        linear = np.einsum("nb,np,ij->nibpj", basis, np.eye(len(points))[point], np.eye(columns.shape[1]))
        linear = linear.reshape(*columns[here].shape[:2], -1)
        joined = found.rows.only(here).product(np.concatenate([columns[here], linear], axis=2))
        kept = columns.shape[2]
        size = _scale(joined)[kept:]
        own, across = size[:, None] * joined[kept:, kept:] * size, joined[:kept, kept:] * size
        products = products + joined[:kept, :kept] - across @ _inverse(own) @ across.T
        rank += int(np.linalg.matrix_rank(own, RANK, hermitian=True))
    return products, rank


def _causes(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Iterator[Cause]:
    """What may be other than told. Sizes in words are in mm, deg, N, Nm, % and micrometres per N."""
    first_three = np.arange(6) < 3
    yield from _of_frames(setup)
    words = "forces that need {0} % against the torques, or torques that need the opposite"
    hidden = "the forces' gain against the torques'", "1 % of it", "%"
    yield Cause(words, 0.01, {"wrench": tests.wrench * first_three}, hidden=hidden)
    for k in range(6):
        name, unit = ("force", "N") if k < 3 else ("torque", "Nm")
        words = f"a {name} of {{0}} {unit} along the sensor's {AXES[k % 3]} axis in every load"
        yield Cause(words, 1.0, {"wrench": -np.eye(6)[k]})
    yield from _of_displacement(chain, setup, tests)
    for joint in range(1, 6):  # joint 1 is a turn of the displacement's axes
        hidden = "a joint's zero", f"1 deg of joint {joint + 1}", "deg"
        words = f"joint {joint + 1} {{0}} deg off its recorded angle"
        yield Cause(words, DEG, {"joints": np.eye(6)[joint]}, hidden=hidden)


def _of_frames(setup: LoadingSetup) -> Iterator[Cause]:
    """Sensor and tool stand elsewhere on the flange."""
    sensor, tool = setup.flange_from_sensor, setup.flange_from_tool
    for k, axis in enumerate(AXES):
        words, which = f"{{0}} mm along its {axis} axis from its place in the cell file", f"1 mm along its {axis} axis"
        along, turn = np.zeros((4, 4)), np.zeros((4, 4))
        along[k, 3], turn[:3, :3] = 1.0, np.cross(np.eye(3)[k], np.eye(3)).T
        moved = {"flange_from_sensor": sensor @ along}
        yield Cause(f"the force sensor {words}", 1.0, {}, moved, ("the force sensor's place", which, "mm"))
        yield Cause(
            f"the force sensor turned by {{0}} deg about its {axis} axis",
            DEG,
            {},
            {"flange_from_sensor": sensor @ turn},
            ("the force sensor's axes", f"1 deg about its {axis} axis", "deg"),
        )
        moved = {"flange_from_tool": tool @ along, "targets_mm": np.eye(3)[k]}
        yield Cause(f"what is tracked {words}", 1.0, {}, moved, ("the place of what is tracked", which, "mm"))


def _of_displacement(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Iterator[Cause]:
    """Axes, scale, drift and backlash of what was tracked, and a base that gives."""
    sensor = (forward_kinematics(chain, tests.joints) @ setup.flange_from_sensor)[:, :3, :3]
    force = (sensor @ tests.wrench[:, :3, None])[..., 0]
    sense = np.sign(np.nanmean(tests.vectors if tests.points else tests.vectors[:, :1], axis=1))
    ever, forwards, labels = np.ones(len(force)), np.linspace(0.0, 1.0, len(force)), np.array(tests.labels)
    names, count = np.unique(labels, return_counts=True)
    alone = names[count >= FEW].tolist() if len(names) > 1 else []

    def everywhere(by: Float) -> dict[str, Float]:
        """All that was tracked moved against `by` (L, 3) mm."""
        return {"moved": -(np.tile(by, tests.points) if tests.points else np.hstack([by, 0.0 * by]))}

    for k, axis in enumerate(AXES):
        way = np.eye(3)[k]
        turned = {"moved": np.cross(way, tests.vectors).reshape(tests.moved.shape)}
        yield Cause(f"the displacements' axes turned by {{0}} deg about the base's {axis} axis", DEG, turned)
        for words, unit, size in (
            (f"a displacement of {{0}} mm along {axis} in every load", 1.0, ever),
            *(
                (f"a displacement of {{0}} mm along {axis} in every load of posture {one}", 1.0, labels == one)
                for one in alone
            ),
            (f"a drift of {{0}} mm along {axis} from the first load to the last", 1.0, forwards),
            (f"backlash: {{0}} mm along {axis} either way", 1.0, sense[:, k]),
            (f"a base or links that give by {{0}} µm/N along {axis}", 1e-3, force[:, k]),
        ):
            yield Cause(words, unit, everywhere(np.outer(size, way)))
    # an even give as one cause too: along one axis it may look like a joint
    yield Cause("a base or links that give by {0} µm/N along every axis", 1e-3, everywhere(force))
    if not tests.points:
        scaled = {"moved": tests.moved * (np.arange(6) < 3)}
        yield Cause("displacements that need {0} % against the rotations", 0.01, scaled)
