"""What straight lines leave of a groove's faces in all profiles alike: forms of the plates, errors of the columns."""

from __future__ import annotations

import math

import numpy as np
import scipy

from workbench.units import Float, Int

PLACE_MM, LEAST_PLACES = 0.25, 8  # of an upper surface, from its end on, that show whether it is straight
STRIP_MM, STRIP_POINTS, STRIP_LEAN = 0.2, 4, 0.06  # from the corner on, what is level beside the end of that surface
FORM_MM = 0.008  # what is left there in all profiles alike; of sensors that err by what walks over the columns 0.005
WALK_PLACES = 9  # stretches of a face's columns
# mm^2 a mm: over 10 mm of columns an error of 0.3 micrometres, for no sensor is straighter, to 30
WALKS = np.geomspace(1e-8, 1e-4, 33)
SHARED_NOISE = np.geomspace(1.0, 100.0, 13)  # times that variance: noise that neighbouring columns share, texture
NOTHING_TOLD = np.zeros((WALKS.size, SHARED_NOISE.size))
SURE = 3.0  # standard deviations
OFTEN = 8  # returns of a column that tell what every profile repeats there


class Form:
    """What the lines of an upper surface leave, mean of all profiles by the distance from its innermost return."""

    def __init__(self) -> None:
        self.total, self.count = np.zeros(0), np.zeros(0)
        self.strips: list[float] = []  # how far off the line what lies between it and the corner is, of each profile

    def add_strip(self, points: Float, plate: tuple[Float, float, float, float], corner: Float) -> None:
        """The returns (m, 2) between an upper surface and its corner: as they are where a tape or primer ends there."""
        centre, angle, *_ = plate
        way = np.array([math.cos(angle), math.sin(angle)])
        beside = points[(corner - points) @ way > STRIP_MM]
        if len(beside) < STRIP_POINTS:
            return
        along, off = (beside - centre) @ way, (beside - centre) @ np.array([-way[1], way[0]])
        level = abs(float(np.polyfit(along, off, 1)[0])) < STRIP_LEAN
        self.strips.append(float(np.median(off)) if level else 0.0)

    def add(self, points: Float, off: Float) -> None:
        """The returns (m, 2) of one profile and what its line leaves of them (m,)."""
        inner = points[np.argmax(points[:, 0])]
        place = (np.hypot(*(points - inner).T) / PLACE_MM).astype(np.int64)
        size = max(int(place.max()) + 1, self.count.size)
        self.total = np.pad(self.total, (0, size - self.total.size)) + np.bincount(place, off, size)
        self.count = np.pad(self.count, (0, size - self.count.size)) + np.bincount(place, minlength=size)

    def found(self) -> tuple[float, float]:
        """u of the line's height at the end, mm, and of its direction, rad.

        By how much lines through the nearest quarter, half and three quarters of the surface differ from it there.
        """
        seen = np.flatnonzero(self.count > 0.5 * np.median(self.count)) if self.count.size else self.count
        if seen.size < LEAST_PLACES:
            return 0.0, 0.0
        strip = abs(float(np.median(self.strips))) if self.strips else 0.0
        strip = strip / math.sqrt(3.0) if strip > FORM_MM else 0.0
        place, mean = (seen + 0.5) * PLACE_MM, self.total[seen] / self.count[seen]
        if np.abs(mean).max() < FORM_MM:
            return strip, 2.0 * strip / float(place[-1])
        parts = [max(seen.size * k // 4, LEAST_PLACES // 2) for k in (1, 2, 3)]
        lines = [np.polyfit(place[:part], mean[:part], 1) for part in parts]
        turn, height = np.abs(lines).max(axis=0) / math.sqrt(3.0)
        return math.hypot(height, strip), math.hypot(turn, 2.0 * strip / float(place[-1]))


class Repeated:
    """What lines leave of a face's returns, along the rays, summed by columns: what every profile repeats."""

    def __init__(self, columns: int) -> None:
        self.total, self.count, self.squares = np.zeros(columns), np.zeros(columns), 0.0

    def add(self, column: Int, off: Float) -> None:
        """Residuals (m,) of one profile's returns in these columns."""
        self.total += np.bincount(column, off, self.total.size)
        self.count += np.bincount(column, minlength=self.count.size)
        self.squares += float((off**2).sum())

    def pattern(self) -> float:
        """Share of the variance that is the same in every profile: of the columns' means, less what chance leaves."""
        many = self.count >= OFTEN
        if not many.any():
            return 0.0
        variance = self.squares / self.count.sum()
        mean = self.total[many] / self.count[many]
        left = np.mean(mean**2 - variance / self.count[many]) / max(variance, 1e-12)
        return float(np.clip(left, 0.0, 1.0))

    def walk(self, width_mm: float) -> Float:
        """Log-likelihood (w, k) of WALKS, by which an error that every profile repeats may grow, and SHARED_NOISE.

        By the means of WALK_PLACES stretches of columns, less a line, which have the noise that their own columns'
        scatter makes of them, or more: neighbours share some of it, and what has no course along a face is no walk.
        NOTHING_TOLD: too few columns.
        """
        column = np.flatnonzero(self.count >= OFTEN)
        if column.size < 4 * WALK_PLACES:
            return NOTHING_TOLD
        means = [self.total[part] / self.count[part] for part in np.array_split(column, WALK_PLACES)]
        place = np.arange(WALK_PLACES) + 0.5
        bends = np.linalg.svd(np.stack([np.ones(WALK_PLACES), place]))[2][2:]  # what no line makes
        left = bends @ [one.mean() for one in means]
        noise = (bends * [one.var(ddof=1) / one.size for one in means]) @ bends.T
        walked = np.minimum.outer(place, place) - np.eye(WALK_PLACES) / 6.0  # of a walk's means over stretches
        grown = bends @ walked @ bends.T * (width_mm / WALK_PLACES)
        variance = WALKS[:, None, None, None] * grown + SHARED_NOISE[:, None, None] * noise
        square = np.einsum("i,wnij,j->wn", left, np.linalg.inv(variance), left)
        return np.asarray(-0.5 * (square + np.linalg.slogdet(variance)[1]))


def likely_walk(logs: list[Float]) -> float:
    """The walk, mm^2 a mm, whose errors are beyond SURE standard deviations as seldom as a known one's; 0: not told.

    logs (w, k): as `Repeated.walk` has them, of each face; a priori all orders of magnitude are alike likely.
    """
    total = np.sum(logs, axis=0)
    if not total.any():
        return 0.0
    share = np.exp(total - total.max()).sum(axis=1)
    beyond = scipy.special.ndtr(-SURE * np.sqrt(WALKS[:, None] / WALKS)) @ (share / share.sum())
    return float(np.exp(np.interp(-scipy.special.ndtr(-SURE), -beyond, np.log(WALKS))))


def repeated_mm(left: Float) -> float:
    """What n profiles leave in the same way in k places (n, k), rms, beyond what chance makes of it."""
    middle = np.median(left, axis=0)
    noise = 1.2533 * np.median(np.abs(left - middle), axis=0) / 0.6745 / math.sqrt(len(left))
    return math.sqrt(max(float(np.mean(middle**2 - noise**2)), 0.0))
