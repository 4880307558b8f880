"""`stiffness.identify_forces`: cutting and edge coefficients from recordings of the milling force."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import scipy
from pydantic import Field

from workbench.api import (
    AnyArray,
    Bool,
    Chapter,
    Cutter,
    Document,
    Float,
    Forces,
    InputError,
    InputFile,
    Int,
    Shaped,
    estimator,
    pieces,
    read_forces,
    result_file,
    stage,
)
from workbench.plugins.ranges import AsBuiltU, HelixDeg, Positive
from workbench.plugins.stiffness.coefficients import NAMES, PUBLISHED, CuttingCoefficients
from workbench.plugins.stiffness.force_stage import Teeth, edges_in_cut, mean_matrices
from workbench.plugins.stiffness.load_checks import unlike
from workbench.plugins.stiffness.tap_tests import unit_vector

LEAST_TURNS = 20
BLOCKS = 10  # of whole turns, whose scatter tells the noise of the mean
SPEED_SHARE = 0.02  # by which the speed found may differ from the one stated
CHATTER_SHARE = 0.1  # of the strongest line's power, between the harmonics of the spindle
ROUNDS = 3  # of run-out and coefficients, which hang on each other
MUCH = 10.0  # times the power, beyond which one line is not another's neighbour by chance
DOWN = np.array([1.0, -1.0, 1.0])  # x, y, z of down-milling over those of up-milling
BELOW = 5.0  # standard uncertainties, by which an edge coefficient may lie below zero
TEETH_SHARE = 0.2  # of means and lines of the teeth, by which these may be off: resonances make 0.14
CLIPPED = 3  # samples in a row on the channel's very extreme
SCALE_U, GAIN_U = 0.02, 0.01  # of dynamometer and depths of cut together; of each axis against the others
ZERO_U_N, WEAR_U = 0.5, 0.02  # of a recording: its zero, along each axis; the share of its edge forces
RUNOUT_U = 0.5  # of what run-out takes, over it
HARDER = {  # what makes K_tc how many times as large as it is
    "are forces in kN": 1e-3,
    "are forces in kgf (9.807 N)": 1 / 9.807,
    "are forces in lbf (4.448 N)": 1 / 4.448,
    "are feeds in inches a minute": 25.4,
    "are feeds in mm/s": 60.0,
    "are feeds in m/min": 1e3,
}
LEAST = 1e-3  # of the stated ones, for a set-up that is exactly as stated
NOT_INCLUDED = (
    "another edge, other cutting speeds, wear of more than some per cent from recording to recording",
    "feeds other than stated: 1 % of an override in all recordings changes the cutting coefficients by 1 %",
)
NOISY = 2.0  # misfit that is told
OF_METALS = 50.0, 12_000.0  # N/mm2, K_tc: magnesium to nickel alloys, at fine feeds
APART = (
    "the means lie {:.1f} times as far off lines in the feed as zeros, gains and wear explain: u holds that as larger "
    "errors of these, not as a feed that was not reached"
)
Axis = Literal["x", "-x", "y", "-y", "z", "-z"]


class Cutting(NamedTuple):
    """What all recordings have in common."""

    cutter: Cutter
    axial_mm: float
    angles: tuple[float, float]  # of a tooth, in and out of the cut, from the normal of the feed towards it
    bandwidth_hz: float
    stated_rpm: float


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """One recording, over whole turns."""

    source: str
    rpm: float  # as found
    turns: int
    mean_n: Shaped[Float, " 3"]  # in the dynamometer's axes
    covariance: Shaped[Float, "3 3"]
    beyond: Shaped[Float, " 3"]  # share of each channel's variance above the dynamometer's bandwidth
    sense: float  # power of the tooth line that turns from x to y, over that which turns back; 1: neither
    once_n: float  # amplitude of the once-per-turn line across the axis
    teeth_n: Shaped[AnyArray, "h 3"]  # lines of the teeth and their harmonics, below the bandwidth


@stage("stiffness.identify_forces")
def identify_forces(
    *,
    recordings: list[InputFile],
    feeds_mm_min: list[Positive],
    spindle_rpm: Positive,
    flutes: Annotated[int, Field(ge=1, le=20)],
    cutter_diameter_mm: Annotated[float, Field(gt=0, le=200)],
    axial_depth_mm: Annotated[float, Field(gt=0, le=200)],
    material: Annotated[str, Field(min_length=1, max_length=80)],
    tool: Annotated[str, Field(min_length=1, max_length=80)],
    radial_depth_mm: Annotated[float | None, Field(gt=0, le=200)] = None,
    direction: Literal["up", "down"] = "up",
    axes: tuple[Axis, Axis, Axis] | None = None,
    bandwidth_hz: Positive = 450.0,
    rate_hz: Annotated[float | None, Field(gt=0, le=1e7)] = None,
    helix_deg: HelixDeg = 30.0,
    as_built_u: AsBuiltU = 1.0,
) -> tuple[Document, Chapter]:
    """Cutting and edge coefficients from the mean forces of whole turns at two feeds or more (Budak et al. 1996).

    Waveforms give spindle speed, sense of rotation and run-out. Writes `coefficients.json` for `stiffness.force`.

    Args:
        recordings: DynoWare exports, or tables with the columns fx_n, fy_n, fz_n and time_s, one a feed.
        feeds_mm_min: number of mm a minute, of each recording.
        spindle_rpm: number of turns a minute, as commanded; the recordings' own is compared with it.
        flutes: number of the cutter's.
        cutter_diameter_mm: of the cutter.
        axial_depth_mm: of the cut.
        material: of the workpiece, for the file.
        tool: that cut, for the file.
        radial_depth_mm: of the cut; null: a slot.
        direction: of a partial cut, which changes the means.
        axes: dynamometer axes (force on the cutter) across the feed into the material, along the feed, and from shank
            to tip; null: found from the signs and the sense of rotation.
        bandwidth_hz: of the dynamometer's flat response; nothing above it is used.
        rate_hz: of tables without time_s.
        helix_deg: of the cutter, right-hand; affects only the run-out.
        as_built_u: factor on the standard uncertainties of gains, depths, zeros and wear (docs/stiffness.md); 0: all
            are as stated.

    Raises:
        InputError: one feed, fewer than 20 whole turns, a saturated channel, chatter, another speed or number of
            flutes; no axes, or several, with positive coefficients; lines of the teeth that contradict the means;
            three times as much, or as little, as is published of the material: another unit.

    Example:
        >>> from workbench.plugins import stiffness
        >>> files = [f"data/synthetic/forces/slot_f{feed}.csv" for feed in (300, 900)]
        >>> cut = {"spindle_rpm": 6000, "flutes": 2, "cutter_diameter_mm": 10, "axial_depth_mm": 3}
        >>> named = {"material": "al7075_t6", "tool": "simulated"}
        >>> file, chapter = stiffness.identify_forces(recordings=files, feeds_mm_min=[300, 900], **cut, **named)
        >>> file.name
        'coefficients.json'
    """
    where = "stiffness.identify_forces"
    if len(recordings) != len(feeds_mm_min):
        raise InputError(where, f"expected one feed a recording, found {len(feeds_mm_min)} for {len(recordings)}")
    if len(set(feeds_mm_min)) < 2:
        raise InputError(where, "expected at least two feeds: one alone does not part cutting from edge forces")
    if radial_depth_mm is not None and radial_depth_mm > cutter_diameter_mm:
        raise InputError(f"{where}: radial_depth_mm", f"expected at most {cutter_diameter_mm:g}, the cutter's diameter")
    last = np.pi if radial_depth_mm is None else np.arccos(1 - 2 * radial_depth_mm / cutter_diameter_mm)
    angles = (0.0, last) if direction == "up" else (np.pi - last, np.pi)
    cutter = Cutter(diameter_mm=cutter_diameter_mm, flutes=flutes, flute_length_mm=axial_depth_mm)
    cut = Cutting(cutter, axial_depth_mm, angles, bandwidth_hz, spindle_rpm)
    recorded = [_recorded(path, read_forces(path, rate_hz), cut) for path in recordings]
    per_tooth = np.array([f / (one.rpm * flutes) for f, one in zip(feeds_mm_min, recorded, strict=True)])
    none = np.zeros((len(recorded), 3))
    tried = [_fitted(recorded, per_tooth, cut, turn, none, as_built_u) for turn in _turns(axes)]
    chosen = _chosen(tried, recorded, axes is not None)
    for _ in range(ROUNDS):
        runout = _run_out(chosen, recorded, per_tooth, cut, np.radians(helix_deg))
        chosen = _fitted(recorded, per_tooth, cut, chosen.turn, runout.lost_n, as_built_u)
    _check_teeth(recorded, chosen, runout)
    misfit = chosen.misfit or 0.0
    if misfit > 1.0:  # the set-up is not as stated: its errors are larger, not the noise of the means
        looser = max(as_built_u, LEAST) * math.sqrt(misfit)
        chosen = _fitted(recorded, per_tooth, cut, chosen.turn, runout.lost_n, looser)._replace(misfit=misfit)
    published, low, high = PUBLISHED.get(material), *OF_METALS
    if published is None and not low < chosen.values[0] < high:
        likely = unlike(chosen.values[0] / math.sqrt(low * high), HARDER)
        raise InputError(
            recorded[0].source,
            f"K_tc would be {chosen.values[0]:.3g} N/mm2, expected {low:g} to {high:g} of a metal: {likely}?",
        )
    if published is not None and (likely := unlike(chosen.values[0] / published.ktc_n_mm2, HARDER)):
        raise InputError(
            recorded[0].source,
            f"K_tc would be {chosen.values[0]:.3g} N/mm2, published of {material} is {published.ktc_n_mm2:.3g}: "
            f"{likely}? or is it another material (name it so)?",
        )
    u = estimator.standard_u(chosen.covariance)
    content = {
        "material": material,
        "tool": tool,
        "cutter_diameter_mm": cutter_diameter_mm,
        "flutes": flutes,
        **dict(zip(NAMES, chosen.values, strict=True)),
        "u": dict(zip(NAMES, u, strict=True)),
        "covariance": chosen.covariance,
        "misfit": chosen.misfit,
        "axes": chosen.words,
        "least_runout_mm": runout.mm,
        "recordings": [
            {
                "file": Path(one.source).name,
                "feed_per_tooth_mm": c,
                "spindle_rpm": one.rpm,
                "turns": one.turns,
                "mean_n": one.mean_n,
                "residual_n": left,
                "variance_beyond_bandwidth": one.beyond,
                "once_per_turn_n": one.once_n,
            }
            for one, c, left in zip(recorded, per_tooth, chosen.left_n, strict=True)
        ],
        "bandwidth_hz": bandwidth_hz,
        "not_included": _not_included(cut, per_tooth, chosen),
    }
    return result_file("coefficients.json", content), _chapter(content, chosen, len(tried))


def _not_included(cut: Cutting, per_tooth: Float, chosen: Tried) -> list[str]:
    """What the means do not show, with what it would change of these coefficients."""
    matrix = mean_matrix(cut, per_tooth)
    mean, later = matrix @ chosen.values, np.argsort(np.argsort(per_tooth))[:, None]
    turned = np.radians(1.0) * np.cross([0.0, 0.0, 1.0], mean)
    causes = {
        "a dynamometer turned by 1 deg about the spindle's axis": turned,
        "a zero that rises by 1 N from feed to feed": np.broadcast_to(later, mean.shape),
        "a depth of cut that rises by 1 % from feed to feed": 0.01 * later * mean,
    }
    misfit = chosen.misfit or 0.0
    said = [APART.format(math.sqrt(misfit))] if misfit > NOISY else []
    for cause, moved in causes.items():
        by = np.linalg.lstsq(matrix.reshape(-1, 6), moved.ravel(), rcond=None)[0]
        said.append(f"{cause}: K_tc by {by[0]:.0f}, K_rc by {by[1]:.0f} N/mm2")
    return [*said, *NOT_INCLUDED]


def _recorded(path: Path, forces: Forces, cut: Cutting) -> Recorded:
    """A recording over whole turns; raises InputError for what cannot be used."""
    value = _channels(path, forces)
    stated = cut.stated_rpm / 60.0
    if len(value) / forces.rate_hz * stated < LEAST_TURNS:
        turns = len(value) / forces.rate_hz * stated
        raise InputError(str(path), f"expected at least {LEAST_TURNS} whole turns, found {turns:.1f}: record longer")
    _check_clipped(path, value)
    turn_hz = _spindle_hz(value, forces.rate_hz, cut)
    if abs(turn_hz / stated - 1) > SPEED_SHARE:
        raise InputError(
            str(path),
            f"expected the spindle at {cut.stated_rpm:g} a minute, found {60 * turn_hz:.0f} in the spectrum: is "
            "spindle_rpm or rate_hz another?",
        )
    per_turn = forces.rate_hz / turn_hz
    turns = int(len(value) / per_turn + 1e-9)
    used = value[: round(turns * per_turn)]
    spectrum = np.fft.fft(used - used.mean(axis=0), axis=0) / len(used)  # line k is k / turns of a turn's frequency
    _check_lines(path, spectrum, turns, turn_hz, cut)
    edges = np.round(np.linspace(0, turns, BLOCKS + 1).astype(int) * per_turn).astype(int)
    blocks = np.array([used[a:b].mean(axis=0) for a, b in itertools.pairwise(edges)])
    hz = np.abs(np.fft.fftfreq(len(used), 1.0 / forces.rate_hz))
    power = np.abs(spectrum) ** 2
    across = np.fft.fft(used[:, 0] + 1j * used[:, 1]) / len(used)
    tooth = cut.cutter.flutes * turns
    orders = _tooth_orders(cut, turn_hz)
    return Recorded(
        source=str(path),
        rpm=60.0 * turn_hz,
        turns=turns,
        mean_n=used.mean(axis=0),
        covariance=np.cov(blocks.T) / BLOCKS + np.eye(3) * 1e-12,
        beyond=power[hz > cut.bandwidth_hz].sum(axis=0) / np.maximum(power.sum(axis=0), 1e-300),
        sense=abs(across[tooth]) ** 2 / max(abs(across[-tooth]) ** 2, 1e-300),
        once_n=np.hypot(abs(across[turns]), abs(across[-turns])),
        teeth_n=spectrum[orders * turns],
    )


def _tooth_orders(cut: Cutting, turn_hz: float) -> Int:
    """Of the teeth's lines below the bandwidth, as multiples of a turn's frequency."""
    return cut.cutter.flutes * np.arange(1, math.ceil(cut.bandwidth_hz / turn_hz / cut.cutter.flutes))


def _channels(path: Path, forces: Forces) -> Float:
    """Fx, Fy, Fz (n, 3), N."""
    try:
        at = [forces.channel.index(name) for name in ("Fx", "Fy", "Fz")]
    except ValueError:
        raise InputError(str(path), f"expected the channels Fx, Fy and Fz, found {', '.join(forces.channel)}") from None
    if any(forces.unit[k] != "N" for k in at):
        raise InputError(str(path), "expected forces in N, found volts: apply the amplifier's scale when exporting")
    return forces.value[:, at]


def _check_clipped(path: Path, value: Float) -> None:
    """Refuse a channel that stays on its extreme; a quantised one meets it now and then, but not in rows."""
    for name, channel in zip(("Fx", "Fy", "Fz"), value.T, strict=True):
        for extreme in (channel.max(), channel.min()):
            on = np.diff(np.flatnonzero(np.concatenate([[True], channel != extreme, [True]]))) - 1
            if channel.std() > 0 and (on >= CLIPPED).sum() >= LEAST_TURNS / 2:
                raise InputError(
                    str(path),
                    f"{name} is saturated: {(on >= CLIPPED).sum()} times {CLIPPED} samples or more in a row at "
                    f"{extreme:.6g} N; record with a larger range",
                )


def _spindle_hz(value: Float, rate_hz: float, cut: Cutting) -> float:
    """Turns a second: where the harmonics of a turn below the bandwidth hold the most power, about what is stated."""
    off = (value - value.mean(axis=0)) * np.hanning(len(value))[:, None]
    time = np.arange(len(off)) / rate_hz
    stated = cut.stated_rpm / 60.0
    most = max(int(cut.bandwidth_hz / stated), 1)
    orders = sorted({1, *(k for k in (cut.cutter.flutes, 2 * cut.cutter.flutes) if k <= most)})

    def power(hz: float) -> float:
        return sum(float((np.abs(np.exp(-2j * np.pi * k * hz * time) @ off) ** 2).sum()) for k in orders)

    width = rate_hz / len(off) / orders[-1]
    at = np.arange(stated * (1 - 2.5 * SPEED_SHARE), stated * (1 + 2.5 * SPEED_SHARE), width / 2)
    best = max(at.tolist(), key=power)
    near = (best - width / 2, best + width / 2)
    return float(scipy.optimize.minimize_scalar(lambda hz: -power(hz), bounds=near, options={"xatol": width / 1e3}).x)


def _check_lines(path: Path, spectrum: AnyArray, turns: int, turn_hz: float, cut: Cutting) -> None:
    """Refuse chatter, and another number of flutes, by the lines below the bandwidth."""
    power = (np.abs(spectrum) ** 2).sum(axis=1)[: len(spectrum) // 2]
    most = min(int(cut.bandwidth_hz / turn_hz * turns), len(power) - 2)
    order = np.arange(most + 1) / turns
    lines = np.array([power[k * turns] for k in range(1, most // turns + 1)])
    if not len(lines):
        return
    between = np.where(np.abs(order - np.round(order)) > 0.25, power[: most + 1], 0.0)
    worst = int(between.argmax())
    if between[worst] > CHATTER_SHARE * lines.max():
        raise InputError(
            str(path),
            f"chatters: a line at {worst / turns * turn_hz:.1f} Hz, between the harmonics of the spindle "
            f"({turn_hz:.2f} Hz), with {100 * np.sqrt(between[worst] / lines.max()):.0f} % of the strongest one's "
            "amplitude; means of a stable cut are needed",
        )
    n = cut.cutter.flutes
    strongest = int(lines.argmax()) + 1
    own = lines[n - 1] if n <= len(lines) else 0.0
    if strongest != 1 and n <= len(lines) and lines[strongest - 1] > MUCH * own:
        raise InputError(
            str(path),
            f"expected {n} flutes, the spectrum has its strongest line at {strongest} times a turn: is 'flutes' wrong?",
        )


class Tried(NamedTuple):
    """How the dynamometer's axes may stand, and what comes of it."""

    turn: Shaped[Float, "3 3"]  # rows: across the feed into the material, along the feed, to the tip; of the cutter
    values: Shaped[Float, " 6"]
    covariance: Shaped[Float, "6 6"]
    misfit: float | None  # chi-square over its degrees of freedom; None: as many coefficients as means
    left_n: Shaped[Float, "n 3"]  # mean forces less those of the fit, cutter's axes

    @property
    def words(self) -> str:
        """The axes, as `axes` takes them."""
        return " ".join(("-" if row.sum() < 0 else "") + "xyz"[int(np.abs(row).argmax())] for row in self.turn)

    @property
    def positive(self) -> bool:
        """Cutting coefficients above zero, and edge coefficients not surely below."""
        edge = self.values[3:] + BELOW * np.sqrt(np.diag(self.covariance)[3:])
        return bool((self.values[:3] > 0).all() and (edge > 0).all())


def _turns(axes: Sequence[str] | None) -> list[Float]:
    """Signed permutations that are tried: z stays z."""
    if axes is not None:
        made = np.array([unit_vector(one) for one in axes])
        if abs(np.linalg.det(made)) < 0.5 or not abs(made[2, 2]):
            raise InputError("stiffness.identify_forces: axes", "expected x, y and z once each, z the last")
        return [made]
    signed = [np.diag(signs) for signs in itertools.product((1.0, -1.0), repeat=3)]
    return [*signed, *(one[[1, 0, 2]] for one in signed)]


def mean_matrix(cut: Cutting, per_tooth_mm: Float) -> Float:
    """(n, 3, 6): mean force over a turn at feeds (n,), linear in the coefficients, axes as in `edges_in_cut`."""
    return cut.axial_mm * mean_matrices(cut.cutter, *cut.angles, per_tooth_mm)[:, :3]


@dataclass(frozen=True, slots=True, eq=False)
class _Means:
    """The estimator's instrument: mean forces by six coefficients, and what of a set-up is not as stated.

    These are unknowns in units of their u: scale, the axes' gains (3), what run-out takes, the zero of each recording
    along each axis (3 n) and the wear of its edges (n).
    """

    mean_n: Shaped[Float, "n 3"]
    covariance: Shaped[Float, "n 3 3"]
    matrix: Shaped[Float, "n 3 6"]
    lost_n: Shaped[Float, "n 3"]  # what run-out takes from the means
    as_built_u: float  # standard uncertainty of all but the run-out's unknown

    def rows(self, at: Float) -> estimator.Rows:
        n, each = len(self.matrix), self.matrix * at[:6]
        ideal, every = each.sum(axis=2), np.eye(3 * n).reshape(n, 3, 3 * n)
        worn = np.eye(n)[:, None] * (WEAR_U * each[..., 3:].sum(axis=2))[..., None]
        causes = (SCALE_U * ideal[..., None], GAIN_U * ideal[..., None] * np.eye(3), RUNOUT_U * self.lost_n[..., None])
        slope = np.concatenate([*causes, ZERO_U_N * every, worn], axis=2)
        u = np.full(slope.shape[2], max(self.as_built_u, LEAST))
        u[4] = 1.0
        left, known = self.mean_n - self.lost_n - ideal - slope @ at[6:], np.zeros((6, 6))
        means = estimator.Rows(left, self.matrix, self.covariance, np.full(n, 3.0), known, known[0])
        return means.beside(slope, at[6:], u)

    def moved(self, at: Float, step: Float) -> Float:
        return at + step


def _fitted(
    recorded: Sequence[Recorded], per_tooth: Float, cut: Cutting, turn: Float, lost_n: Float, as_built_u: float
) -> Tried:
    """Coefficients of the mean forces; `lost_n` (n, 3) is what run-out takes from them."""
    mean = np.array([turn @ one.mean_n for one in recorded])
    covariance = np.array([turn @ one.covariance @ turn.T for one in recorded])
    means = _Means(mean, covariance, mean_matrix(cut, per_tooth), lost_n, as_built_u)
    found = estimator.fit(means, np.zeros(11 + 4 * len(recorded)))
    misfit = found.misfit if found.freedom > 0 else None
    return Tried(turn, found.at[:6], found.covariance[:6, :6], misfit, found.rows.residual)


def _chosen(tried: Sequence[Tried], recorded: Sequence[Recorded], stated: bool) -> Tried:
    """The one way that gives forces above zero and turns as the recorded force does."""
    sense = np.exp(np.mean([np.log(one.sense) for one in recorded]))
    # 1: the dynamometer's x, y turn into each other as the cutter's do; -1: the other way
    handed = np.linalg.det(np.array([one.turn[:2, :2] for one in tried]))
    turning: Bool = (sense**handed >= 1.0) | stated
    positive = np.array([one.positive for one in tried])
    fitting = [one for one, a, b in zip(tried, turning, positive, strict=True) if a and b]
    where = recorded[0].source
    if len(fitting) == 1:
        return fitting[0]
    if not fitting:
        ktc, krc, kac, *_ = tried[int(turning.argmax())].values
        which = f"these axes ({ktc:.0f}, {krc:.0f}, {kac:.0f} N/mm2)" if stated else "any axes"
        raise InputError(
            where,
            f"expected coefficients above zero, found none with {which}: are the feeds in the recordings' order, the "
            "direction and the depths those of the cut?",
        )
    raise InputError(where, f"several axes fit: {'; '.join(one.words for one in fitting)}; name them by 'axes'")


class RunOut(NamedTuple):
    """What the once-per-turn line says."""

    mm: float  # at least, where tooth 1 stands worst
    lost_n: Shaped[Float, "n 3"]  # mean force with it less that without: where a chip ends, its edge force does too
    teeth_n: tuple[Shaped[Float, "h 2"], ...]  # amplitudes with it of the lines of the teeth, across and along the feed


def _run_out(tried: Tried, recorded: Sequence[Recorded], per_tooth: Float, cut: Cutting, helix: float) -> RunOut:
    """The least run-out that makes the lines; none of one flute."""
    # down-milling is up-milling with forces towards the axis, and those along the feed, the other way
    down = cut.angles[0] > 0.0
    of = CuttingCoefficients(*(tried.values * np.where(down, [1, -1, 1, 1, -1, 1], 1.0)))
    radial_mm = cut.cutter.diameter_mm / 2 * (1.0 - np.cos(cut.angles[1] - cut.angles[0]))

    def through(size: float, angle: float) -> Float:
        radial, axial = (np.full(len(per_tooth), one) for one in (radial_mm, cut.axial_mm))
        turn = edges_in_cut(cut.cutter, per_tooth, radial, axial, Teeth(helix, size, angle)).forces(of)
        return turn[..., :3] * np.where(down, DOWN, 1.0)

    def line(size: float, angle: float) -> Float:
        turn = through(size, angle)
        lines = np.fft.fft(turn[..., 0] + 1j * turn[..., 1]) / turn.shape[1]
        return np.array([np.hypot(abs(one[1]), abs(one[-1])) for one in lines])

    size = 0.1 * per_tooth.min() * (cut.cutter.flutes > 1)
    angles, once_n = np.linspace(0, np.pi, 13)[:-1], np.array([one.once_n for one in recorded])
    worst = max(angles.tolist(), key=lambda angle: line(size, angle)[0])
    for _ in range(ROUNDS * (size > 0.0)):  # a tooth that no longer cuts everywhere makes lines out of proportion
        size *= np.mean(once_n / line(size, worst))
    turns = through(size, worst)
    lost_n = (turns - through(0.0, worst)).mean(axis=1)
    lines = np.abs(np.fft.fft(turns[..., :2], axis=1)) / turns.shape[1]
    orders = [_tooth_orders(cut, one.rpm / 60.0) for one in recorded]
    return RunOut(size, lost_n, tuple(line[at] for line, at in zip(lines, orders, strict=True)))


def _check_teeth(recorded: Sequence[Recorded], chosen: Tried, runout: RunOut) -> None:
    """Refuse means and waveforms that no cut has together: coefficients are fitted to the means alone."""
    shown = np.concatenate([np.abs(one.teeth_n @ chosen.turn.T)[:, :2] for one in recorded])
    made = np.concatenate(runout.teeth_n)
    means = np.array([(chosen.turn @ one.mean_n)[:2] for one in recorded])
    off = np.linalg.norm(shown - made) / np.hypot(np.linalg.norm(means) / math.sqrt(2.0), np.linalg.norm(shown))
    if off > TEETH_SHARE:
        across, along = shown[0]
        raise InputError(
            recorded[0].source,
            f"expected lines of the teeth of {made[0, 0]:.3g} N across and {made[0, 1]:.3g} N along the feed, as the "
            f"means have them, found {across:.3g} and {along:.3g} N ({100 * off:.0f} % off, at most "
            f"{100 * TEETH_SHARE:g}): is radial_depth_mm another, an axis another, or the gain of a channel?",
        )


def _chapter(content: dict[str, Any], chosen: Tried, tried: int) -> Chapter:
    """What the file has as `content`, of one of so many ways of the axes that were tried."""
    u, names = list(content["u"].values()), ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
    named = zip(names, chosen.values, u, strict=True)
    rows = [(n, f"{k:.4g} ± {2 * s:.2g}", "N/mm²" if n[-1] == "c" else "N/mm") for n, k, s in named]
    every = content["recordings"]
    of = {
        "Feed per tooth, mm": ("{:.4g}", [one["feed_per_tooth_mm"] for one in every]),
        "rev/min": ("{:.1f}", [one["spindle_rpm"] for one in every]),
        "Turns": ("{}", [one["turns"] for one in every]),
        "Mean force, N": ("{:.1f}, {:.1f}, {:.1f}", [chosen.turn @ one["mean_n"] for one in every]),
        "Residual, N": ("{:.2f}, {:.2f}, {:.2f}", chosen.left_n),
        "Variance beyond bandwidth, %": (
            "{:.0f}, {:.0f}, {:.0f}",
            [100 * one["variance_beyond_bandwidth"] for one in every],
        ),
    }
    misfit = chosen.misfit
    summary = (
        f"Cutting coefficients of {content['material']}: K_tc = {chosen.values[0]:.0f} N/mm² ± {2 * u[0]:.0f} "
        f"(k = 2), from {len(every)} recordings"
    )
    text = (
        pieces.table_html(("Coefficient", "Value ± U", "Unit"), rows)
        + pieces.columns_html(of)
        + pieces.paragraph(
            f"Dynamometer's axes, as the cutter has them: {chosen.words} ({tried} tried). Misfit: "
            + ("none, as many coefficients as means" if misfit is None else f"{misfit:.2f} (1 is usual)")
            + f". Run-out by the once-per-turn line: at least {content['least_runout_mm']:.4f} mm."
        )
        + pieces.list_html([f"Not included: {one}" for one in content["not_included"]])
    )
    return Chapter("Cutting coefficients", text, summary=summary)
