"""Which passes: the least time in which every station reaches the wanted uncertainty.

All sets of candidates in order of time that may be better: exact for as many passes as are asked for. Where no set
reaches what is wanted, the one that leaves the fewest stations unseen, of these the fewest short, and comes nearest.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from workbench.scan_plan.information import RESERVE, Joint, Knowledge, Predicted, Profiler, View, combined, information
from workbench.units import COVERAGE, Bool, Int, Shaped

MOST_SETS = 500  # of ways to look that are tried where nothing reaches what is wanted


class Wanted(NamedTuple):
    """Expanded uncertainties, k = 2."""

    root_mm: float
    bevel_deg: float


class Candidate(NamedTuple):
    """A pass that could be driven."""

    view: View
    half_turn: bool  # by half a turn about the rays
    sees: Shaped[Bool, " k"]  # stations
    seconds: float


class Learned(NamedTuple):
    """What a rehearsal of views together promised over what the search thinks of them."""

    views: tuple[View, ...]
    root: float
    bevel: float

    def away(self, views: tuple[View, ...]) -> tuple[bool, float]:
        """How far other views are from these: of another kind, and by elevation.

        With a lead the robot's errors along the edge count; from below a radius is in the form of the faces.
        """
        mine, others = (np.array([one.elevation for one in each]) for each in (self.views, views))
        apart = np.abs(mine[:, None] - others)
        return _kind(views) != _kind(self.views), float(apart.min(axis=0).mean() + apart.min(axis=1).mean())


def _kind(views: tuple[View, ...]) -> tuple[bool, bool]:
    return any(one.lead for one in views), any(one.elevation < 0.0 for one in views)


class Reach(NamedTuple):
    """How a set of passes does: compared in this order."""

    unseen: int  # stations
    short: int  # that miss what is wanted, those included
    excess: float  # largest of what they promise over what is wanted, where that is more
    seconds: float
    leads: int  # passes that lean along the edge, where errors of the robot along it count and shadows end aslant
    left: float  # product of promised over wanted U of both sizes, at most: of two sets as good the one that tells more


@dataclass
class Search:
    """The candidates of one edge."""

    joint: Joint
    profiler: Profiler
    known: Knowledge
    length_mm: float
    wanted: Wanted
    candidates: Sequence[Candidate]
    learned: list[Learned] = field(default_factory=list)

    def views(self, passes: tuple[int, ...]) -> tuple[View, ...]:
        """Of these passes."""
        return tuple(self.candidates[k].view for k in passes)

    def predicted(self, passes: tuple[int, ...]) -> Predicted:
        """What these passes tell together where all of them see the edge."""
        return _prediction(self.joint, self.profiler, self.known, self.views(passes), self.length_mm)

    def over(self, passes: tuple[int, ...]) -> tuple[float, float]:
        """Promised over wanted U of root face and bevel angle where all of these passes see the edge."""
        prediction = self.predicted(passes)
        root, bevel = prediction.most_root_mm / self.wanted.root_mm, prediction.bevel_deg / self.wanted.bevel_deg
        by_distance = ((one.away(self.views(passes)), one) for one in self.learned)
        (other, _), nearest = min(by_distance, default=((True, 0.0), None))
        if nearest is not None and not other:
            root, bevel = nearest.root * root, nearest.bevel * bevel
        return RESERVE * COVERAGE * root, RESERVE * COVERAGE * bevel

    def patterns(self, passes: tuple[int, ...]) -> tuple[list[tuple[int, ...]], Int]:
        """Which of these passes see the edge together somewhere, and of each station the number of its pattern."""
        sees = np.stack([self.candidates[k].sees for k in passes])
        codes, which = np.unique((1 << np.arange(len(passes))) @ sees, return_inverse=True)
        return [tuple(k for i, k in enumerate(passes) if code >> i & 1) for code in codes.tolist()], which.ravel()

    def reach(self, passes: tuple[int, ...]) -> Reach:
        """How these passes do."""
        groups, which = self.patterns(passes)
        each = np.array([self.over(group) if group else (math.inf, math.inf) for group in groups])[which]
        over, left = each.max(axis=1), each.prod(axis=1)
        short = over > 1.0
        seen = np.isfinite(over)
        excess = float(over[short & seen].max(initial=0.0))
        leads = sum(self.candidates[k].view.lead != 0.0 for k in passes)
        worst = float(left[seen].max(initial=0.0))
        return Reach(int((~seen).sum()), int(short.sum()), excess, self._seconds(passes), leads, worst)

    @property
    def visible(self) -> Bool:
        """Stations (k,) that any candidate sees."""
        return np.asarray(np.any([one.sees for one in self.candidates], axis=0))

    def best(self, most_passes: int) -> tuple[tuple[int, ...], Reach]:
        """The best set of at most so many passes.

        A pass with more frames tells more: where a set with its finest pitches misses what is wanted, so do others.
        """
        hidden, looked = int((~self.visible).sum()), 0
        best: tuple[tuple[int, ...], Reach] = ((), Reach(self.visible.size + 1, 0, math.inf, math.inf, 0, math.inf))
        ways = self._ways()
        quickest = min((self.candidates[way[0]].seconds for way in ways), default=math.inf)
        for size in range(1, most_passes + 1):  # few passes first: their time bounds the others
            if best[1].short == hidden and size * quickest > best[1].seconds:
                break
            for several in itertools.combinations_with_replacement(ways, size):
                unseen = int((~np.any([self.candidates[way[0]].sees for way in several], axis=0)).sum())
                if looked == MOST_SETS or unseen > best[1].unseen:
                    continue
                choices = self._choices(several)
                reached = best[1].short == hidden
                if not choices or (reached and self._seconds(choices[0]) > best[1].seconds):
                    continue
                looked += 1
                finest = self.reach(choices[-1])
                best = min(best, (choices[-1], finest), key=itemgetter(1))
                for passes in choices[:-1] if finest.short == hidden else ():
                    if self._seconds(passes) > best[1].seconds:
                        break
                    best = min(best, (passes, self.reach(passes)), key=itemgetter(1))
        return best

    def _ways(self) -> list[list[int]]:
        """Candidates that differ in frame pitch alone, the quickest first."""
        found: dict[tuple[View, bool, bytes], list[int]] = {}
        for k in sorted(range(len(self.candidates)), key=lambda k: self.candidates[k].seconds):
            one = self.candidates[k]
            found.setdefault((one.view._replace(frame_pitch_mm=0.0), one.half_turn, one.sees.tobytes()), []).append(k)
        return list(found.values())

    def _choices(self, ways: Sequence[list[int]]) -> list[tuple[int, ...]]:
        """Sets of one candidate of each way, no candidate twice, the quickest first."""
        parts = [itertools.combinations(way, len(list(same))) for way, same in itertools.groupby(ways)]
        sets = [tuple(sorted(itertools.chain.from_iterable(one))) for one in itertools.product(*parts)]
        return sorted(sets, key=self._seconds)

    def _seconds(self, passes: Sequence[int]) -> float:
        return sum(self.candidates[k].seconds for k in passes)


@functools.lru_cache(maxsize=8192)
def _prediction(
    joint: Joint, profiler: Profiler, known: Knowledge, views: tuple[View, ...], length_mm: float
) -> Predicted:
    """What views that see the joint determine together: as much with a lead to either side."""
    unsigned = [view._replace(lead=abs(view.lead)) for view in views]
    each = [information(joint, profiler, known, view, length_mm) for view in unsigned]
    return combined(joint, known, [one for one in each if one is not None], length_mm)
