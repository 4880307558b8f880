"""What six springs do not explain in loading tests: causes as unknowns with priors, named where they are beyond these.

A sensor that stands elsewhere, a joint's zero, a base that gives, a force that is scaled: each *cause* is a direction
in which the displacements would lie (docs/stiffness_metrology.md, eq. (L1) to (L3)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy

from workbench.api import DEG, Bool, Chain, Float, LoadingSetup, Shaped, estimator, forward_kinematics
from workbench.plugins.stiffness.equations import TYPICAL, Equations, Loading, equations
from workbench.plugins.stiffness.values import LoadingTests

SURE_SIGMAS = 4.0  # by which a cause is beyond what was stated of it: of 60 causes one in 260 sound sets has one
MOST_CAUSES, MOST_NAMED = 8, 3
CHANCE = 1e-3  # that sound loads count as lacking fit
RANK = 1e-6  # share of the information below which there is none
STEP = 1e-3  # of each cause's unit, for its direction
FEW = 4  # loads of a posture, from which on it may be off by itself
AXES = "xyz"

# How well an ordinary cell and robot are known (u): what no load shows stays as large
PLACE_U_MM, TURN_U_DEG, TRACKED_TURN_U_DEG = 1.0, 0.5, 0.05
GAIN_U = 0.01  # of the forces against the torques, of each channel, of displacements against rotations
ZERO_U_DEG = 0.3  # of a joint, as `calibrate.robot` has it
GIVE_U_UM_N = 0.01  # of a base, along each axis
LINK_U = 0.005  # of a link's compliance across its joint's axis, over the joint's: the paper's links are rigid
NOISE_U = 0.2  # of what is the same in several displacements, over their noise
BACKLASH_U_MM = 0.002
LEAST = 1e-3  # of the stated priors, for a cell that stands exactly as stated


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """What the residuals say beyond noise."""

    causes: str  # in words, the surest first; empty: none
    change: Shaped[Float, " 6"]  # rad/Nm, by which the causes that are told change the compliance
    widened: float  # variance of the residuals that follow the loads, over the noise's; at least 1
    hidden: tuple[str, ...]  # what an error beyond what was assumed of it would change, with its size


@dataclass(frozen=True, slots=True)
class Cause:
    """Something that is not as the cell file and the loads say, in units of `unit`."""

    words: str  # "{0}" is replaced by its size
    unit: float  # what 1 of `words` is in the units of `changed`
    u: float  # standard uncertainty of how it was stated, in units of `unit`
    of_tests: dict[str, Float] = field(default_factory=dict)  # what 1 of `unit` adds to their fields
    of_setup: dict[str, Float] = field(default_factory=dict)
    direction: Float | None = None  # (L, r) of 1 of `unit`, where it is none of the fields'
    hidden: tuple[str, str, str] | None = None  # where it may not show: its kind, 1 of it in words, the unit


def with_causes(
    chain: Chain,
    setup: LoadingSetup,
    tests: LoadingTests,
    found: estimator.Fit[Float],
    labels: estimator.Labels,
    as_built_u: float,
) -> tuple[Loading, estimator.Fit[Float], LackOfFit]:
    """The compliance with causes as unknowns, each with its prior; one that is beyond its prior is reported, and free.

    found: the fit of six springs; as_built_u: times the stated priors, 0: causes are reported, but not in the rest's u.
    """
    eq = equations(chain, setup, tests)
    causes, loading = _held(chain, setup, tests, eq, found.at, as_built_u)
    columns, u, links = loading.directions, loading.u, np.array([cause.direction is not None for cause in causes])
    _, noise2, _ = _repeated(tests, loading, found)
    give = _give(loading, loading.fit(found.used), links, noise2)
    u[links] = give or u[links]
    free, first = list[int](), None
    while True:
        loading = Loading(eq, columns, u)
        fitted = loading.fit(found.used)
        first = fitted.at[:6] if first is None else first
        size, known = fitted.at[6:], np.diag(fitted.inverse)[6:]
        seen = np.maximum(1.0 / known - u**-2.0, RANK / known)  # information of the loads alone
        gain = np.where(np.isfinite(u), np.abs(size) / (known * np.sqrt(seen) * np.hypot(1.0, u * np.sqrt(seen))), 0.0)
        gain /= np.sqrt(noise2)
        best = int(gain.argmax())
        if gain[best] < SURE_SIGMAS or len(free) == MOST_CAUSES:
            break
        free.append(best)
        u[best] = np.inf
    fitted, _ = estimator.without_blunders(loading, fitted.at, labels)
    return loading, fitted, _lack(tests, loading, fitted, causes, free, first, give)


def promised(chain: Chain, setup: LoadingSetup, tests: LoadingTests, compliance: Float, as_built_u: float) -> Float:
    """Covariance (6, 6) of the compliance, (rad/Nm)^2, that tests not yet made will leave, by noise and causes.

    tests: of which nothing but `moved` is unknown; compliance (6,): as expected, rad/Nm.
    """
    loading = _held(chain, setup, tests, equations(chain, setup, tests), compliance, as_built_u)[1]
    normal = loading.rows(np.append(compliance, np.zeros(len(loading.u)))).normal()
    return estimator.inverse_information(normal.information)[:6, :6]


def _held(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, eq: Equations, compliance: Float, as_built_u: float
) -> tuple[list[Cause], Loading]:
    """The causes, and the loads with these as unknowns; directions made of what was measured would share its noise."""
    modelled = replace(tests, moved=np.where(eq.seen, eq.y - eq.residual(compliance), np.nan))
    causes = list(_causes(chain, setup, modelled, eq, compliance))
    here = equations(chain, setup, modelled).residual(compliance)
    plain, directions = Loading(eq), []
    for cause in causes:
        if cause.direction is not None:
            directions.append(plain.observed(cause.direction))
            continue
        stands = setup.model_copy(update=_changed(setup, cause.of_setup, cause.unit))
        seen = replace(modelled, **_changed(modelled, cause.of_tests, cause.unit))
        directions.append(plain.observed(equations(chain, stands, seen).residual(compliance) - here) / -STEP)
    u = np.array([cause.u for cause in causes]) * max(as_built_u, LEAST)
    return causes, Loading(eq, np.stack(directions, axis=2), u)


def _give(loading: Loading, found: estimator.Fit[Float], links: Bool, noise2: float) -> float:
    """What links give across the axes of their joints, % of these (RMS), by likelihood; 0: not seen beside u.

    noise2: variance of the residuals that no compliance explains, over the noise's.
    """

    def likelihood(give: float) -> float:
        u = np.where(links, give, loading.u)
        rows = Loading(loading.eq, loading.directions, u).rows(found.at)
        rows = replace(rows, residual=rows.residual / np.sqrt(noise2), jacobian=rows.jacobian / np.sqrt(noise2))
        return rows.only(found.used).normal().restricted - float(np.log(u).sum())

    least = loading.u[links][0]
    tried = np.geomspace(least, max(100.0, 2.0 * least), 12)[1:]
    most = int(np.argmax(every := [likelihood(give) for give in tried]))
    return tried[most] if every[most] - likelihood(least) > 0.5 * SURE_SIGMAS**2 else 0.0


def _lack(
    tests: LoadingTests,
    loading: Loading,
    found: estimator.Fit[Float],
    causes: list[Cause],
    free: list[int],
    first: Float,
    give: float,
) -> LackOfFit:
    """What is left of a fit whose causes `free` have no prior; first (6,): the compliance with none of them free."""
    residual = found.rows.residual[found.used][..., None]
    repeated, noise2, linear = _repeated(tests, loading, found)
    sure = estimator.standard_u(found.inverse)
    held = 1.0 - sure[6:] ** 2 * loading.u**-2.0  # of each cause, by the loads
    freedom = linear - 6 - held.sum()
    lacking = found.rows.only(found.used).product(residual)[0, 0] - repeated
    chance = freedom < 1 or lacking < noise2 * scipy.special.chdtri(freedom, CHANCE)
    words = [
        f"{causes[k].words.format(f'{found.at[6 + k]:+.3g}')} (± {sure[6 + k]:.2g}, {loading_u:.2g} was allowed for)"
        for k, loading_u in ((k, causes[k].u) for k in free[:MOST_NAMED])
    ]
    if give:
        words.insert(0, f"links that give across the axes of their joints, by some {give:.2g} % of what these give")
    more = [f"and {len(free) - MOST_NAMED} more"] if len(free) > MOST_NAMED else []
    bias = np.abs(found.inverse[:6, 6:]) * loading.u**-2.0
    return LackOfFit(
        "; ".join([*words, *more]),
        found.at[:6] - first,
        1.0 if chance else lacking / freedom,
        _hidden(causes, found, bias.T, loading.u),
    )


def _hidden(causes: list[Cause], found: estimator.Fit[Float], changes: Float, u: Float) -> tuple[str, ...]:
    """Of each kind of cause the one that changes a joint most where it is further off than was assumed.

    changes (m, 6): rad/Nm for each unit of a cause; u (m,): what was assumed of it.
    """
    known, worst = estimator.standard_u(found.inverse)[:6], dict[str, tuple[float, str]]()
    for cause, change, held in zip(causes, changes, u, strict=True):
        if cause.hidden is None or not np.isfinite(held):
            continue
        kind, which, unit = cause.hidden
        joint = int((change / known).argmax())
        share, times = 100.0 * change[joint] / abs(found.at[joint]), change[joint] / known[joint]
        words = f"{kind}: {which} changes joint {joint + 1} by {share:.2g} % ({times:.2g} u); u holds {held:.2g} {unit}"
        worst[kind] = max(worst.get(kind, (0.0, "")), (times * held, words))
    return tuple(words for _, words in worst.values())


def _changed(one: LoadingSetup | LoadingTests, by: dict[str, Float], unit: float) -> dict[str, Any]:
    """Its fields with STEP units of a cause in them."""
    return {name: getattr(one, name) + STEP * unit * change for name, change in by.items()}


def _repeated(tests: LoadingTests, loading: Loading, found: estimator.Fit[Float]) -> tuple[float, float, int]:
    """Of the residuals without all that is linear in the wrench at its posture, which no compliance explains.

    Their chi-square, their variance over the noise's, at least 1, and the freedom of the rest.
    """
    chi2, freedom, rank = 0.0, 0, 0
    scale = np.maximum(np.abs(tests.wrench).max(axis=0), 1e-12)
    wrench, of_point = (tests.wrench / scale)[loading.load], np.eye(max(tests.points, 1))[loading.point]
    postures = np.unique(np.round(tests.joints, 9), axis=0, return_inverse=True)[1].reshape(-1)[loading.load]
    for posture in np.unique(postures[found.used]):
        here = found.used & (postures == posture)
        residual = found.rows.residual[here]
        linear = np.einsum("nb,np,ij->nibpj", wrench[here], of_point[here], np.eye(residual.shape[1]))
        columns = np.concatenate([linear.reshape(*residual.shape, -1), residual[..., None]], axis=2)
        joined = found.rows.only(here).product(columns)
        normal = estimator.Normal(joined[:-1, :-1], joined[:-1, -1], joined[-1, -1], 0.0)
        size = np.sqrt(np.maximum(np.diagonal(normal.information), 1e-12))
        chi2 += normal.chi2 - float(normal.side @ normal.step())
        rank += int(np.linalg.matrix_rank(normal.information / np.outer(size, size), RANK, hermitian=True))
        freedom += int(found.rows.values[here].sum())
    return chi2, max(chi2 / (freedom - rank), 1.0) if freedom > rank else 1.0, rank


def _causes(
    chain: Chain, setup: LoadingSetup, tests: LoadingTests, eq: Equations, compliance: Float
) -> Iterator[Cause]:
    """What may be other than stated. Sizes in words are in mm, deg, N, Nm, % and micrometres per N."""
    first_three = np.arange(6) < 3
    yield from _of_frames(setup)
    words = "forces that need {0} % against the torques, or torques that need the opposite"
    hidden = "the forces' gain against the torques'", "1 % of it", "%"
    yield Cause(words, 0.01, 100 * GAIN_U, {"wrench": tests.wrench * first_three}, hidden=hidden)
    for k in range(6):
        name, unit = ("force", "N") if k < 3 else ("torque", "Nm")
        channel = f"the {name} along the sensor's {AXES[k % 3]} axis"
        scaled = {"wrench": tests.wrench * np.eye(6)[k]}
        hidden = "a channel's gain", f"1 % of {channel}", "%"
        yield Cause(f"{channel} needs {{0}} %", 0.01, 100 * GAIN_U, scaled, hidden=hidden)
        words = f"a {name} of {{0}} {unit} along the sensor's {AXES[k % 3]} axis in every load"
        yield Cause(words, 1.0, eq.wrench_noise[k], {"wrench": -np.eye(6)[k]})
    yield from _of_displacement(chain, setup, tests)
    for joint in range(1, 6):  # joint 1 is a turn of the displacement's axes
        hidden = "a joint's zero", f"1 deg of joint {joint + 1}", "deg"
        words = f"joint {joint + 1} {{0}} deg off its recorded angle"
        yield Cause(words, DEG, ZERO_U_DEG, {"joints": np.eye(6)[joint]}, hidden=hidden)
    for k in range(12):
        soft = max(abs(compliance[k % 6]), 0.1 * TYPICAL)
        words = f"links that give across the axis of joint {k % 6 + 1}, by {{0}} % of what the joint gives"
        yield Cause(words, 0.01, 100 * LINK_U, direction=0.01 * soft * eq.links[:, :, k])


def _of_frames(setup: LoadingSetup) -> Iterator[Cause]:
    """Sensor and tool stand elsewhere on the flange."""
    sensor, tool = setup.flange_from_sensor, setup.flange_from_tool
    for k, axis in enumerate(AXES):
        words, which = f"{{0}} mm along its {axis} axis from its place in the cell file", f"1 mm along its {axis} axis"
        along, turn = np.zeros((4, 4)), np.zeros((4, 4))
        along[k, 3], turn[:3, :3] = 1.0, np.cross(np.eye(3)[k], np.eye(3)).T
        moved = {"flange_from_sensor": sensor @ along}
        hidden = ("the force sensor's place", which, "mm")
        yield Cause(f"the force sensor {words}", 1.0, PLACE_U_MM, {}, moved, hidden=hidden)
        hidden = ("the force sensor's axes", f"1 deg about its {axis} axis", "deg")
        words_turn = f"the force sensor turned by {{0}} deg about its {axis} axis"
        yield Cause(words_turn, DEG, TURN_U_DEG, {}, {"flange_from_sensor": sensor @ turn}, hidden=hidden)
        moved = {"flange_from_tool": tool @ along, "targets_mm": np.eye(3)[k]}
        hidden = ("the place of what is tracked", which, "mm")
        yield Cause(f"what is tracked {words}", 1.0, PLACE_U_MM, {}, moved, hidden=hidden)


def _of_displacement(chain: Chain, setup: LoadingSetup, tests: LoadingTests) -> Iterator[Cause]:
    """Axes, scale, drift and backlash of what was tracked, and a base that gives."""
    sensor = (forward_kinematics(chain, tests.joints) @ setup.flange_from_sensor)[:, :3, :3]
    force = (sensor @ tests.wrench[:, :3, None])[..., 0]
    sense = np.sign(np.nanmean(tests.vectors if tests.points else tests.vectors[:, :1], axis=1))
    ever, forwards, labels = np.ones(len(force)), np.linspace(0.0, 1.0, len(force)), np.array(tests.labels)
    names, count = np.unique(labels, return_counts=True)
    alone = names[count >= FEW].tolist() if len(names) > 1 else []
    noise = NOISE_U * (setup.target_noise_mm if tests.points else setup.displacement_noise_mm)

    def everywhere(by: Float) -> dict[str, Float]:
        """All that was tracked moved against `by` (L, 3) mm."""
        return {"moved": -(np.tile(by, tests.points) if tests.points else np.hstack([by, 0.0 * by]))}

    for k, axis in enumerate(AXES):
        way = np.eye(3)[k]
        rotated = {"moved": np.cross(way, tests.vectors).reshape(tests.moved.shape)}
        words = f"the displacements' axes turned by {{0}} deg about the base's {axis} axis"
        yield Cause(words, DEG, TRACKED_TURN_U_DEG, rotated)
        every = f"a displacement of {{0}} mm along {axis} in every load"
        for words, unit, u, size in (
            (every, 1.0, noise, ever),
            *((f"{every} of posture {one}", 1.0, noise, labels == one) for one in alone),
            (f"a drift of {{0}} mm along {axis} from the first load to the last", 1.0, noise, forwards),
            (f"backlash: {{0}} mm along {axis} either way", 1.0, BACKLASH_U_MM, sense[:, k]),
            (f"a base or links that give by {{0}} µm/N along {axis}", 1e-3, GIVE_U_UM_N, force[:, k]),
        ):
            yield Cause(words, unit, u, everywhere(np.outer(size, way)))
    # an even give as one cause too: along one axis it may look like a joint
    yield Cause("a base or links that give by {0} µm/N along every axis", 1e-3, GIVE_U_UM_N, everywhere(force))
    if not tests.points:
        scaled = {"moved": tests.moved * (np.arange(6) < 3)}
        yield Cause("displacements that need {0} % against the rotations", 0.01, 100 * GAIN_U, scaled)
