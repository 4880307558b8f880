"""The interval score of values and their standard uncertainties against the truth. MIT licence; numpy alone.

A value with error e and standard uncertainty u states the interval of plus or minus k u, k = 1.96, which is to hold
the truth in 95 of 100 cases. It costs (Gneiting and Raftery 2007, eq. 43, alpha = 0.05, 2 / alpha = 40)

    IS = 2 k u + 40 max(0, |e| - k u):

the width of the interval, and 40 times what lies outside. The score is proper: of errors normally distributed with
standard deviation s the mean is least, 4.68 s, where u = s. What was refused, or is missing where the edge can be seen,
costs its price. The seen edge is cut into nine equal pieces; values in one share its weight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
K, MISS, PIECES, OFF_MM = 1.959964, 40.0, 9, 15.0  # a value stated farther from the edge is none of it
U_OVER_T = 0.2  # ISO 14253-1: U = 2 u is useful up to this share of the tolerance
SCALES = {"mm": (1.0, 0.3), "deg": (2.0, 1.0)}  # price of a missing value; tolerance (half its width) U is held against
SCALES |= {"translation_mm": (10.0, 1.0), "rotation_deg": (5.0, 0.5)}  # who refuses is left with the design's hand-eye
PLAIN = ("root_mm", "bevel_deg", "gap_mm", "depth_mm")
RAW = ("along_n_mm", "along_m_mm", "axis_deg", "heading_deg")


class Found(NamedTuple):
    """A quantity of a recording: errors, standard uncertainties, pieces (k,); pieces (j,) that had to be told."""

    error: Array
    u: Array
    piece: NDArray[np.int64]
    wanted: NDArray[np.int64]

    def cost(self, price: float) -> Array:
        """Of every piece that was told or had to be: the mean of its values, or the price."""
        each, every = interval_score(self.error, self.u, price), np.union1d(self.piece, self.wanted)
        return np.array([each[self.piece == k].mean() if k in self.piece else price for k in every])


def interval_score(error: ArrayLike, u: ArrayLike, price: float) -> Array:
    """Cost of each value, in its unit; NaN as error or u, and u of 0 or less, are missing values at the `price`.

    >>> interval_score([0.0, 0.1, np.nan], [0.05, 0.01, np.nan], 1.0).round(3).tolist()
    [0.196, 3.255, 1.0]
    """
    e, s = np.broadcast_arrays(np.abs(np.asarray(error, float)), np.asarray(u, float))
    cost = 2.0 * K * s + MISS * np.maximum(0.0, e - K * s)
    return np.where(np.isfinite(cost) & (s > 0.0), cost, price)


def project(chain: Array, place: Array) -> tuple[Array, Any, Array, Array]:
    """Of points (k, 3) on a chain (n, 3): arc length, the station before, the share of the way on, the distance."""
    length = np.linalg.norm(step := np.diff(chain, axis=0), axis=1)
    share = np.einsum("ksi,si->ks", place[:, None] - chain[None, :-1], step / length[:, None] ** 2)
    away = np.linalg.norm(place[:, None] - chain[:-1] - np.clip(share, 0.0, 1.0)[..., None] * step, axis=2)
    first, row = away.argmin(axis=1), np.arange(len(place))
    share[:, 1:], share[:, :-1] = np.maximum(share[:, 1:], 0.0), np.minimum(share[:, :-1], 1.0)  # beyond its ends: on
    arc = np.concatenate([[0.0], length.cumsum()])
    return arc[first] + share[row, first] * length[first], first, share[row, first], away[row, first]


def compare(truth: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, Found]:
    """One recording of a truth file and of a submission ({}: refused): every quantity that the truth has."""
    if "flange_from_profiler" in truth:
        return _hand_eye(np.array(truth["flange_from_profiler"], float), found)
    true = {name: np.array(values, float) for name, values in truth.items() if isinstance(values, list)}
    chain, seen, rows, out = true["position_mm"], true["seen"] > 0, found.get("sections") or (), {}
    arc = np.concatenate([[0.0], np.linalg.norm(np.diff(chain, axis=0), axis=1).cumsum()])
    low, high = arc[seen][[0, -1]] if seen.any() else arc[[0, -1]]
    ends = np.linspace(low, high, PIECES + 1)[1:-1]
    wanted = np.setdiff1d(np.searchsorted(ends, arc[seen]), np.searchsorted(ends, arc[~seen]))  # seen whole

    def column(name: str, *shape: int) -> Array:
        return np.array([_entry(row, name, *shape) for row in rows], float).reshape(-1, *shape)

    def at(name: str) -> Array:
        return np.asarray(((1.0 - share) * true[name][first].T + share * true[name][first + 1].T).T)

    place = column("origin_mm", 3)
    along, first, share, away = project(chain, np.nan_to_num(place))
    if "normal" in true:
        n, m, t = ((v / np.linalg.norm(v, axis=1, keepdims=True)) for v in map(at, ("normal", "across", "tangent")))
        off, normal, sine = place - at("position_mm"), column("normal", 3), np.cross(column("tangent", 3), t)
        turn = np.arctan2((normal * m).sum(axis=1), (normal * n).sum(axis=1))
        heading = np.arcsin(np.clip(np.linalg.norm(sine, axis=1), 0.0, 1.0))
        places = (off * n).sum(axis=1), (off * m).sum(axis=1)
        errors = dict(zip(RAW, (*places, np.degrees(turn), np.degrees(heading)), strict=True))
    else:
        errors = {name: column(name) - at(name) for name in PLAIN if name in true and np.isfinite(true[name]).any()}
    for name, error in errors.items():
        u = column(u_of(name))
        good = np.isfinite(error) & (u > 0.0) & (away <= OFF_MM)
        whole = wanted[: 0 if name in true and not np.isfinite(true[name]).all() else None]
        out[name] = Found(error[good], u[good], np.searchsorted(ends, along[good]), whole)
    return out


def _hand_eye(true: Array, found: Mapping[str, Any]) -> dict[str, Found]:
    """Translation, and to first order the rotation vector w of R_true = exp(w) R in the flange: three values each."""
    pose = _entry(found, "flange_from_profiler", 4, 4)
    turn, out = np.degrees(true[:3, :3] @ pose[:3, :3].T) / 2.0, {}
    w = turn[[2, 0, 1], [1, 2, 0]] - turn[[1, 2, 0], [2, 0, 1]]
    for name, error in (("translation_mm", true[:3, 3] - pose[:3, 3]), ("rotation_deg", w)):
        u = _entry(found, u_of(name), 3)
        good = np.isfinite(error) & (u > 0.0)
        out[name] = Found(error[good], u[good], np.arange(3)[good], np.arange(3))
    return out


def _entry(row: Mapping[str, Any], name: str, *shape: int) -> Array:
    return np.full(shape, np.nan) if row.get(name) is None else np.array(row[name], float)


def u_of(name: str) -> str:
    """The key of its standard uncertainty: root_u_mm of root_mm."""
    return "_u_".join(name.rsplit("_", 1))


def scale(name: str) -> tuple[float, float]:
    """Price and tolerance of a quantity."""
    return SCALES.get(name, SCALES[name.rsplit("_", 1)[1]])


def card(parts: Sequence[Found], name: str) -> dict[str, float]:
    """The score of a quantity over recordings, every piece counting alike; shares in 1, NaN: nothing was measured."""
    price, tolerance = scale(name)
    cost = np.concatenate([p.cost(price) for p in parts])
    e = np.abs(np.concatenate([p.error for p in parts]))
    u = np.concatenate([p.u for p in parts])

    def over(reduce: Callable[[Any], Any], values: Any) -> float:
        return float(reduce(values)) if values.size else float("nan")

    useful = [np.isin(p.wanted, p.piece[2.0 * p.u <= U_OVER_T * tolerance]) for p in parts]
    return {
        "score": over(np.mean, cost),
        "recordings": len(parts),
        "refused": sum(not p.error.size and p.wanted.size > 0 for p in parts),
        "values": e.size,
        "coverage": over(np.mean, e <= 2.0 * u),  # within U = 2 u
        "beyond_4u": over(np.mean, e > 4.0 * u),
        "worst_error_over_u": over(np.max, e / u),
        "sharpness": over(np.median, 2.0 * u),  # median U
        "rms_error": over(np.mean, e**2) ** 0.5,
        "useful": over(np.mean, np.concatenate(useful)),
    }
