"""What six springs do not explain in loading tests: a lack of fit, in u and with the cause that fits it best.

Residuals that are as the noise predicts in size may still follow the loads: a sensor that stands elsewhere, a base that
gives, a force that is scaled. Each *cause* is a direction d in which the residuals would lie; it is found where they do
by more than chance (docs/stiffness_metrology.md, eq. (L1) to (L3)).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.api import DEG, Chain, Float, LoadingSetup, Shaped, estimator, forward_kinematics, rotation_from_vector
from workbench.plugins.stiffness.equations import Equations, Loading, equations
from workbench.plugins.stiffness.values import LoadingTests

SURE_SIGMAS = 5.0  # of a cause: of 40 causes one in 40,000 sound sets of loads has one
MOST_CAUSES, TOLD = 8, 3
CHANCE = 1e-3  # that sound loads count as lacking fit
RANK = 1e-6  # singular values of the wrenches below this share are none
STEP = 1e-3  # of each cause's unit, for its direction
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
    changed: Callable[[float], tuple[LoadingSetup, LoadingTests]]
    hidden: tuple[str, str, str] | None = None  # where it may not show: its kind, 1 of it in words, the unit


def lack_of_fit(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, loading: Loading, found: estimator.Fit[Float]
) -> LackOfFit:
    """Causes that the residuals show, what they do to the compliance, and how much else follows the loads."""
    modelled = _modelled(tests, loading.eq, found)  # a direction made of what was measured would share its noise
    causes = list(_causes(chain, setup, modelled))
    directions = [direction_of(cause, chain, setup, modelled, loading, found) for cause in causes]
    columns = np.stack([*np.moveaxis(found.rows.jacobian, 2, 0), *directions, found.rows.residual], axis=2)
    whole = found.rows.only(found.used).product(columns[found.used])
    repeated, linear = _repeated(tests, loading, found, columns)
    scale = _scale(whole)
    whole, repeated = (scale[:, None] * one * scale for one in (whole, repeated))
    others = float(found.rows.values[found.used].sum()) - linear
    taken, told = list(range(6)), list[str]()
    while len(told) < MOST_CAUSES:
        left = _without(whole, taken)
        noise2 = max(_without(repeated, taken)[-1, -1] / scale[-1] ** 2 / others, 1.0) if others > 0 else 1.0
        size, push = np.diagonal(left)[6:-1], left[6:-1, -1]
        gain = np.where(size > RANK, push**2 / np.maximum(size, RANK), 0.0) / scale[-1] ** 2 / noise2
        gain[np.array(taken[6:], int) - 6] = 0.0
        best = int(np.argmax(gain))
        if gain[best] < SURE_SIGMAS**2:
            break
        value = push[best] / size[best] * scale[6 + best] / scale[-1]
        told.append(f"{causes[best].words.format(f'{value:+.3g}')} ({np.sqrt(gain[best]):.0f} standard uncertainties)")
        taken.append(6 + best)
    solved = scale[taken] * (_inverse(whole[np.ix_(taken, taken)])[0] @ whole[taken, -1]) / scale[-1]
    lacking = (_without(whole, taken) - _without(repeated, taken))[-1, -1] / scale[-1] ** 2
    freedom = linear - len(taken)
    chance = freedom < 1 or lacking < scipy.special.chdtri(freedom, CHANCE)
    untold = [k for k in range(6, len(whole) - 1) if k not in taken]
    changes = (scale[:6, None] * _inverse(whole[:6, :6])[0] @ whole[:6, untold]) / scale[untold]
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


def direction_of(
    cause: Cause,
    chain: Chain,
    setup: LoadingSetup,
    modelled: LoadingTests,
    loading: Loading,
    found: estimator.Fit[Float],
) -> Float:
    """(n, d): by how much the residuals would be smaller if a cause of size 1 were put right."""
    here, other = (
        equations(chain, *one).residual(found.at) for one in ((setup, modelled), cause.changed(STEP * cause.unit))
    )
    return loading.observed(here - other) / STEP


def _scale(products: Float) -> Float:
    """What makes columns (c,) with these products of length 1; 0 of one that is nothing, as of a joint never turned."""
    square = np.diagonal(products)
    return np.divide(1.0, np.sqrt(square), out=np.zeros_like(square), where=square > 0.0)


def _inverse(matrix: Float) -> tuple[Float, int]:
    """Inverse of products (c, c) of columns of length 1, none along what they do not hold; and their rank."""
    values, vectors = np.linalg.eigh(matrix)
    held = values > RANK
    return (vectors[:, held] / values[held]) @ vectors[:, held].T, int(held.sum())


def _without(products: Float, taken: list[int]) -> Float:
    """Products (c, c) of columns after what the columns `taken` explain of them."""
    across = products[:, taken]
    return np.asarray(products - across @ _inverse(products[np.ix_(taken, taken)])[0] @ across.T)


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
        inverse, more = _inverse(size[:, None] * joined[kept:, kept:] * size)
        across = joined[:kept, kept:] * size
        products, rank = products + joined[:kept, :kept] - across @ inverse @ across.T, rank + more
    return products, rank


def _modelled(tests: LoadingTests, eq: Equations, found: estimator.Fit[Float]) -> LoadingTests:
    """The loads with the displacements that the springs would have; points that were not seen stay so."""
    moved = np.where(eq.seen, eq.y - eq.residual(found.at), np.nan)
    if tests.displacement is not None:
        return dataclasses.replace(tests, displacement=moved)
    return dataclasses.replace(tests, targets_mm=moved.reshape(len(moved), -1, 3))


def _causes(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Iterator[Cause]:
    """What may be other than told. Sizes in words are in mm, deg, N, Nm, % and micrometres per N."""
    yield from _of_frames(setup, tests)
    yield from _of_wrench(setup, tests)
    yield from _of_displacement(chain, setup, tests)
    for joint in range(1, 6):  # joint 1 is a turn of the displacement's axes

        def turned(v: float, joint: int = joint) -> tuple[LoadingSetup, LoadingTests]:
            return setup, dataclasses.replace(tests, joints=tests.joints + v * np.eye(6)[joint])

        words = f"joint {joint + 1} {{0}} deg off its recorded angle"
        yield Cause(words, DEG, turned, ("a joint's zero", f"1 deg of joint {joint + 1}", "deg"))


def _of_frames(setup: LoadingSetup, tests: LoadingTests) -> Iterator[Cause]:
    """Sensor and tool stand elsewhere on the flange."""
    for k, axis in enumerate(AXES):

        def moved(v: float, k: int = k) -> tuple[LoadingSetup, LoadingTests]:
            return dataclasses.replace(setup, flange_from_sensor=_moved(setup.flange_from_sensor, v, k)), tests

        def turned(v: float, k: int = k) -> tuple[LoadingSetup, LoadingTests]:
            return dataclasses.replace(setup, flange_from_sensor=_turned(setup.flange_from_sensor, v, k)), tests

        def tool(v: float, k: int = k) -> tuple[LoadingSetup, LoadingTests]:
            shifted = setup.targets_mm + v * np.eye(3)[k]
            return dataclasses.replace(
                setup, flange_from_tool=_moved(setup.flange_from_tool, v, k), targets_mm=shifted
            ), tests

        words, which = f"{{0}} mm along its {axis} axis from its place in the cell file", f"1 mm along its {axis} axis"
        yield Cause(f"the force sensor {words}", 1.0, moved, ("the force sensor's place", which, "mm"))
        words_turned = f"the force sensor turned by {{0}} deg about its {axis} axis"
        yield Cause(words_turned, DEG, turned, ("the force sensor's axes", f"1 deg about its {axis} axis", "deg"))
        yield Cause(f"what is tracked {words}", 1.0, tool, ("the place of what is tracked", which, "mm"))


def _moved(pose: Float, v: float, axis: int) -> Float:
    out = pose.copy()
    out[:3, 3] += v * pose[:3, axis]
    return out


def _turned(pose: Float, v: float, axis: int) -> Float:
    out = pose.copy()
    out[:3, :3] = pose[:3, :3] @ rotation_from_vector(v * np.eye(3)[axis])
    return out


def _of_wrench(setup: LoadingSetup, tests: LoadingTests) -> Iterator[Cause]:
    """Forces scaled against torques, and a wrench that is not 0 without load."""

    def scaled(v: float) -> tuple[LoadingSetup, LoadingTests]:
        return setup, dataclasses.replace(tests, wrench=tests.wrench * ([1 + v] * 3 + [1.0] * 3))

    yield Cause("forces that need {0} % against the torques", 0.01, scaled)
    for k in range(6):

        def offset(v: float, k: int = k) -> tuple[LoadingSetup, LoadingTests]:
            return setup, dataclasses.replace(tests, wrench=tests.wrench - v * np.eye(6)[k])

        name, unit = ("force", "N") if k < 3 else ("torque", "Nm")
        yield Cause(f"a {name} of {{0}} {unit} along the sensor's {AXES[k % 3]} axis in every load", 1.0, offset)


def _of_displacement(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Iterator[Cause]:
    """Axes, scale, drift and backlash of what was tracked, and a base that gives."""
    force = (_sensor_axes(chain, setup, tests) @ tests.wrench[:, :3, None])[..., 0]
    forwards = np.linspace(0.0, 1.0, len(tests.lines))
    sense = np.sign(_shift(tests))

    def added(v: float, along: Float) -> tuple[LoadingSetup, LoadingTests]:
        return setup, _shifted(tests, v * along)

    for k, axis in enumerate(AXES):
        unit = np.eye(3)[k]

        def turned(v: float, unit: Float = unit) -> tuple[LoadingSetup, LoadingTests]:
            return setup, _changed(tests, lambda d: d @ rotation_from_vector(v * unit).T)

        yield Cause(f"the displacements' axes turned by {{0}} deg about the base's {axis} axis", DEG, turned)
        for words, along in (
            (f"a displacement of {{0}} mm along {axis} in every load", np.ones(len(forwards))),
            (f"a drift of {{0}} mm along {axis} from the first load to the last", forwards),
            (f"backlash: {{0}} mm along {axis} either way", sense[:, k]),
        ):
            column = np.outer(along, -unit)
            yield Cause(words, 1.0, lambda v, column=column: added(v, column))  # type: ignore[misc]
        give = np.outer(force[:, k], -unit)
        yield Cause(f"a base or links that give by {{0}} µm/N along {axis}", 1e-3, lambda v, g=give: added(v, g))  # type: ignore[misc]
    # an even give as one cause too: along one axis it may look like a joint
    yield Cause("a base or links that give by {0} µm/N along every axis", 1e-3, lambda v: added(v, -force))
    if tests.displacement is not None:
        displacement = tests.displacement

        def scaled(v: float) -> tuple[LoadingSetup, LoadingTests]:
            return setup, dataclasses.replace(tests, displacement=displacement * ([1 + v] * 3 + [1.0] * 3))

        yield Cause("displacements that need {0} % against the rotations", 0.01, scaled)


def _sensor_axes(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Float:
    return np.asarray((forward_kinematics(chain, tests.joints) @ setup.flange_from_sensor)[:, :3, :3])


def _shift(tests: LoadingTests) -> Float:
    """(L, 3) mm: of the tool, or of the tracked points that were seen, on average."""
    if tests.displacement is not None:
        return tests.displacement[:, :3]
    assert tests.targets_mm is not None
    seen = np.isfinite(tests.targets_mm)
    return np.asarray(np.where(seen, tests.targets_mm, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1))


def _shifted(tests: LoadingTests, by: Float) -> LoadingTests:
    """All that was tracked moved by `by` (L, 3) mm."""
    if tests.displacement is not None:
        return dataclasses.replace(
            tests, displacement=tests.displacement + np.column_stack([by, np.zeros((len(by), 3))])
        )
    assert tests.targets_mm is not None
    return dataclasses.replace(tests, targets_mm=tests.targets_mm + by[:, None])


def _changed(tests: LoadingTests, change: Callable[[Float], Float]) -> LoadingTests:
    """Vectors of what was tracked, each changed."""
    if tests.displacement is not None:
        halves = [change(tests.displacement[:, :3]), change(tests.displacement[:, 3:])]
        return dataclasses.replace(tests, displacement=np.concatenate(halves, axis=1))
    assert tests.targets_mm is not None
    return dataclasses.replace(tests, targets_mm=change(tests.targets_mm))
