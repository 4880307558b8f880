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

from workbench.api import DEG, Chain, Float, Int, LoadingSetup, Shaped, forward_kinematics, rotation_from_vector
from workbench.plugins.stiffness.equations import Equations, Estimate, curvature, equations, whiten
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


@dataclass(frozen=True, slots=True)
class _Cause:
    """Something that is not as the cell file and the loads say, in units of `unit`."""

    words: str  # "{0}" is replaced by its size
    unit: float  # what 1 of `words` is in the units of `changed`
    changed: Callable[[float], tuple[LoadingSetup, LoadingTests]]


def lack_of_fit(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, eq: Equations, found: Estimate, use: Float
) -> LackOfFit:
    """Causes that the residuals show, what they do to the compliance, and how much else follows the loads."""
    whitened = whiten(eq, np.abs(found.compliance)) * use[:, None, None]
    rest = _whole(whitened, found.residual)
    columns = (whitened @ eq.a).reshape(-1, 6)
    groups = _wrench_spaces(tests, use)
    modelled = _modelled(tests, eq, found)  # a direction made of what was measured would share its noise
    as_modelled = equations(chain, setup, modelled)
    directions = [
        (cause, _whole(whitened, _direction(chain, as_modelled, found, *cause.changed(STEP * cause.unit)) / STEP))
        for cause in _causes(chain, setup, modelled)
    ]
    told: list[str] = []
    taken = columns
    while len(told) < MOST_CAUSES and directions:
        basis = np.linalg.qr(taken / _sizes(taken))[0]
        left = rest - basis @ (basis.T @ rest)
        noise2 = _noise(left.reshape(len(use), -1), groups, eq)
        gains = []
        for _, direction in directions:
            free = direction - basis @ (basis.T @ direction)
            size = float(free @ free)
            own = size > RANK * float(direction @ direction) > 0
            gains.append((float(free @ left) / size, float(free @ left) ** 2 / size / noise2) if own else (0.0, 0.0))
        best = int(np.argmax([gain for _, gain in gains]))
        value, gain = gains[best]
        if gain < SURE_SIGMAS**2:
            break
        cause, direction = directions.pop(best)
        told.append(f"{cause.words.format(f'{value:+.3g}')} ({np.sqrt(gain):.0f} standard uncertainties)")
        taken = np.column_stack([taken, direction])
    sizes = _sizes(taken)
    solved = np.linalg.lstsq(taken / sizes, rest, rcond=None)[0] / sizes
    left = (rest - taken @ solved).reshape(len(use), -1)
    more = [f"and {len(told) - TOLD} more"] if len(told) > TOLD else []
    return LackOfFit(
        "; ".join([*told[:TOLD], *more]), np.asarray(solved[:6]), _widened(left, groups, eq, taken.shape[1])
    )


def _sizes(columns: Float) -> Float:
    """Lengths of columns (n, m), to divide by: a joint that no load turns has 0."""
    size = np.linalg.norm(columns, axis=0)
    return np.asarray(np.where(size > 0.0, size, 1.0))


def _whole(whitened: Float, rows: Float) -> Float:
    """Rows (L, r) of equal variance, one after the other; 0 where a load is left out or a point not seen."""
    return np.asarray((whitened @ rows[..., None]).reshape(-1))


def _modelled(tests: LoadingTests, eq: Equations, found: Estimate) -> LoadingTests:
    """The loads with the displacements that the springs would have; points that were not seen stay so."""
    moved = np.where(eq.seen > 0, eq.y - found.residual, np.nan)
    if tests.displacement is not None:
        return dataclasses.replace(tests, displacement=moved)
    return dataclasses.replace(tests, targets_mm=moved.reshape(len(moved), -1, 3))


def _direction(chain: Chain, eq: Equations, found: Estimate, setup: LoadingSetup, tests: LoadingTests) -> Float:
    """(L, r): by how much the residuals would be smaller under another setup, or if the loads were others."""
    other = equations(chain, setup, tests)

    def residual(of: Equations) -> Float:
        return (of.y - curvature(of, found.compliance) - of.a @ found.compliance) * of.seen

    return residual(eq) - residual(other)


def _wrench_spaces(tests: LoadingTests, use: Float) -> list[tuple[Int, Float]]:
    """Of each posture: its loads (n,) and an orthonormal basis (n, <= 6) of what is linear in the wrench."""
    spaces = []
    scale = np.maximum(np.abs(tests.wrench).max(axis=0), 1e-12)
    for posture in np.unique(np.round(tests.joints, 9), axis=0):
        at = np.flatnonzero((np.abs(tests.joints - posture).max(axis=1) < 1e-8) & (use > 0))
        if not len(at):
            continue
        u, s, _ = np.linalg.svd(tests.wrench[at] / scale, full_matrices=False)
        spaces.append((at, u[:, s > RANK * s[0]]))
    return spaces


def _shares(left: Float, spaces: list[tuple[Int, Float]], eq: Equations) -> tuple[float, float, float, float]:
    """Sum of squares that is linear in the wrench at its posture, its freedom; the same of all the rest."""
    linear = freedom = other = others = 0.0
    for at, basis in spaces:
        whole = float((left[at] ** 2).sum())
        inside = float(((basis.T @ left[at]) ** 2).sum())
        rows = float(eq.seen[at].sum()) / len(at)
        linear, freedom = linear + inside, freedom + rows * basis.shape[1]
        other, others = other + whole - inside, others + rows * (len(at) - basis.shape[1])
    return linear, freedom, other, others


def _noise(left: Float, spaces: list[tuple[Int, Float]], eq: Equations) -> float:
    """Variance over the noise's that repeats at no posture, at least 1: eq. (L1)."""
    _, _, other, others = _shares(left, spaces, eq)
    return max(other / others, 1.0) if others > 0 else 1.0


def _widened(left: Float, spaces: list[tuple[Int, Float]], eq: Equations, unknowns: int) -> float:
    """Variance of what is linear in the wrench, which is all that the compliance sees; 1 where chance explains it."""
    linear, freedom, _, _ = _shares(left, spaces, eq)
    freedom -= unknowns
    if freedom < 1 or linear < scipy.special.chdtri(freedom, CHANCE):
        return 1.0
    return linear / freedom


def _causes(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Iterator[_Cause]:
    """What may be other than told. Sizes in words are in mm, deg, N, Nm, % and micrometres per N."""
    yield from _of_frames(setup, tests)
    yield from _of_wrench(setup, tests)
    yield from _of_displacement(chain, setup, tests)
    for joint in range(1, 6):  # joint 1 is a turn of the displacement's axes

        def turned(v: float, joint: int = joint) -> tuple[LoadingSetup, LoadingTests]:
            return setup, dataclasses.replace(tests, joints=tests.joints + v * np.eye(6)[joint])

        yield _Cause(f"joint {joint + 1} {{0}} deg off its recorded angle", DEG, turned)


def _of_frames(setup: LoadingSetup, tests: LoadingTests) -> Iterator[_Cause]:
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

        yield _Cause(f"the force sensor {{0}} mm along its {axis} axis from its place in the cell file", 1.0, moved)
        yield _Cause(f"the force sensor turned by {{0}} deg about its {axis} axis", DEG, turned)
        yield _Cause(f"what is tracked {{0}} mm along its {axis} axis from its place in the cell file", 1.0, tool)


def _moved(pose: Float, v: float, axis: int) -> Float:
    out = pose.copy()
    out[:3, 3] += v * pose[:3, axis]
    return out


def _turned(pose: Float, v: float, axis: int) -> Float:
    out = pose.copy()
    out[:3, :3] = pose[:3, :3] @ rotation_from_vector(v * np.eye(3)[axis])
    return out


def _of_wrench(setup: LoadingSetup, tests: LoadingTests) -> Iterator[_Cause]:
    """Forces scaled against torques, and a wrench that is not 0 without load."""

    def scaled(v: float) -> tuple[LoadingSetup, LoadingTests]:
        return setup, dataclasses.replace(tests, wrench=tests.wrench * ([1 + v] * 3 + [1.0] * 3))

    yield _Cause("forces that need {0} % against the torques", 0.01, scaled)
    for k in range(6):

        def offset(v: float, k: int = k) -> tuple[LoadingSetup, LoadingTests]:
            return setup, dataclasses.replace(tests, wrench=tests.wrench - v * np.eye(6)[k])

        name, unit = ("force", "N") if k < 3 else ("torque", "Nm")
        yield _Cause(f"a {name} of {{0}} {unit} along the sensor's {AXES[k % 3]} axis in every load", 1.0, offset)


def _of_displacement(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Iterator[_Cause]:
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

        yield _Cause(f"the displacements' axes turned by {{0}} deg about the base's {axis} axis", DEG, turned)
        for words, along in (
            (f"a displacement of {{0}} mm along {axis} in every load", np.ones(len(forwards))),
            (f"a drift of {{0}} mm along {axis} from the first load to the last", forwards),
            (f"backlash: {{0}} mm along {axis} either way", sense[:, k]),
        ):
            column = np.outer(along, -unit)
            yield _Cause(words, 1.0, lambda v, column=column: added(v, column))  # type: ignore[misc]
        give = np.outer(force[:, k], -unit)
        yield _Cause(f"a base or links that give by {{0}} µm/N along {axis}", 1e-3, lambda v, g=give: added(v, g))  # type: ignore[misc]
    # an even give as one cause too: along one axis it may look like a joint
    yield _Cause("a base or links that give by {0} µm/N along every axis", 1e-3, lambda v: added(v, -force))
    if tests.displacement is not None:
        displacement = tests.displacement

        def scaled(v: float) -> tuple[LoadingSetup, LoadingTests]:
            return setup, dataclasses.replace(tests, displacement=displacement * ([1 + v] * 3 + [1.0] * 3))

        yield _Cause("displacements that need {0} % against the rotations", 0.01, scaled)


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
