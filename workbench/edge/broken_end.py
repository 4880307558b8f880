"""The broken lower end of a face: how far its virtual edge lies beyond the last return (docs/method.md, eq. (12)).

The break belongs to the edge; what a scanning pass sees of it belongs to the pass. One posterior over the templates
(`edge/end_templates.py`), by the depths in all passes and by where their returns end, gives each pass the mean of what
it does not see, and its standard uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud
from workbench.checks.sensor import column_pitch_mm
from workbench.checks.window import hidden_columns_u
from workbench.edge.drawn_end import DrawnEnd, drawn_end
from workbench.edge.end_templates import (
    ALL_RETURN,
    ALONE,
    ANY_FOOTPRINT,
    FILLS,
    FOOTPRINTS,
    INCIDENCE_PRIOR,
    ONWARD,
    OTHERWISE,
    PRIORS,
    QUARTER,
    SIZES,
    Depths,
    EdgeCondition,
    EndTemplates,
    EndView,
    Pixels,
    SeenEnd,
    end_phases,
    end_templates,
    free_depths,
    possible_pixels,
    reaches,
    seen_end,
)
from workbench.edge.last_returns import (
    DEEP_MM,
    DEPTH_U_MM,
    LEAST_FRAMES,
    LEAST_GROUPS,
    STEP_MM,
    FaceRim,
    end_groups,
    last_returns,
    pattern_noise,
    sampled,
)
from workbench.edge.lower_fillet import LowerFillet
from workbench.geometry.chains import FaceLines
from workbench.geometry.course import CHANCE, LEAST_SHARED, fit_course, shares, stretches
from workbench.geometry.grids import dark_beyond
from workbench.geometry.medians import medians
from workbench.geometry.moves import arc_lengths_mm
from workbench.geometry.poses import in_planes
from workbench.units import DEG, AnyArray, Bool, Float, Int, Shaped

FAINTEST = 1e-4  # share of the returns that may be fainter than what the sensor asks for: noise of the brightness
NO_LIGHT = 0.1  # probability that a recorded brightness does not count the light of a pixel
STILL = 3.0  # columns: where the end moves by less over the pass, its place within one is not all places in turn
LEAST_MEANS = 8
FAR = 4.5  # times the median distance from the median: three standard deviations
STEADY = 0.2 * DEG  # sway of the view by which the returns of a break go on by some micrometres more or less
USUALLY_WITHIN = 0.3  # of the logarithm of a break's size along an edge
UNLIKELY = 1e-3  # share of templates that are not cut finer
NEGLIGIBLE = 2e-4  # share of pixels that the finer templates are not seen by
# What footprints cut off a corner: share of it by which it may be off; the same in columns times the fold; corners that
# are worn; and columns beside a corner.
CUT_SPREAD, CUT_U, WORN, AROUND = 0.7, 0.015, 0.03, 8.0
PROOF = 4.5  # log-likelihood over a sharp end from which a break is told by name
NOT_SHARP = "the edge was declared sharp, and its last returns show that it is not: the declaration was not used"
ALIKE_RAD = 10.0 * DEG  # views that differ by so much hide other parts of a break
ALIKE_MM, CELL_MM = 0.003, 4.0  # views of passes that differ by less count alike; of edge, in which they share places
DARK_COLUMNS, SELDOM = np.arange(4, 24), 0.1  # beyond a face's end; share of them that return where no surface does


@dataclass(frozen=True, slots=True, eq=False)
class BrokenEnd:
    """What the posterior over the templates says of N frames; zeros where the face's end is no free one."""

    beyond_mm: Shaped[Float, " N"]  # of the virtual edge, from where the returns on the line end: its mean
    u_mm: Shaped[Float, " N"]  # and standard uncertainty, common to the frames of a pass
    hidden_u_mm: Shaped[Float, " N"]  # the same by columns that do not show where it ends (`hidden_columns_u`)
    size_mm: float  # radius of a rounding, height of a chamfer, where the edge is proven broken; else 0
    rim_mm: float  # of the face before its last return on the line, or its corner, along x, that is broken
    together_u_mm: Shaped[Float, " N"]  # `u_mm` where passes show the same edge, by what all of them see of its place
    share: Shaped[Float, "t i"]  # of the templates under each incidence
    seen: Mapping[int, SeenEnd]  # by pass
    own_mm: Shaped[Float, " N"]  # of `beyond_mm`, by how much more that is here than on average over the pass
    drawn: DrawnEnd | None = None  # burrs at the end; None: none
    contradicts: bool = False  # whether it was declared sharp, and the returns prove that it is not

    @property
    def doubt_mm(self) -> Float:
        """Standard uncertainty (N,), mm, of all that a frame does not show of the end."""
        return np.hypot(self.u_mm, self.hidden_u_mm)

    def agreed(self, s: Float, end_mm: Float, pass_index: Int, is_corner: Bool) -> BrokenEnd:
        """The same, by the places as well at which passes see the edge end: each template says that they are one.

        Args:
            s: (N,) of the frames along the edge, mm.
            end_mm: (N,) where their returns on the line end, mm along the face; NaN: not seen.
            pass_index: (N,) their passes.
            is_corner: (N,) frames that show the edge itself, at `end_mm`.

        Source: eq. (12c) of docs/method.md.
        """
        none = np.zeros(self.share.shape)
        nothing = SeenEnd(none, none, none, none[..., None], none[..., None], 0.0)
        views = [((pass_index == p) & ~is_corner, seen) for p, seen in self.seen.items()]
        views += [((pass_index == p) & is_corner, nothing) for p in np.unique(pass_index[is_corner])]
        end_mm = end_mm + self.own_mm
        known = np.isfinite(s) & np.isfinite(end_mm)
        if len(views) < 2 or not known.any():
            return self
        cell = stretches(s[known], CELL_MM)
        ends = np.stack([_by_cells(cell[on[known]], end_mm[known & on], int(cell.max()) + 1) for on, _ in views])
        overlap = _common_views(np.isfinite(ends))
        if len(overlap) < 2:
            return self
        apart_from_these = [view for k, view in enumerate(views) if k not in overlap]
        views, ends = [views[k] for k in overlap], ends[overlap]
        shared = ends[:, np.isfinite(ends).all(axis=0)]
        off = shared - shared.mean(axis=0)
        place, noise = off.mean(axis=1)[:, None], off.var(axis=1, ddof=1)[:, None] / shared.shape[1]
        at = place + np.array([seen.beyond.ravel() for _, seen in views])
        spread = np.array([seen.beyond_u.ravel() for _, seen in views])
        lean = np.array([seen.inclination for _, seen in views])
        alike = np.exp(-np.abs(lean[:, None] - lean) / ALIKE_RAD)
        alone = noise + ALIKE_MM**2
        weight = 1.0 / (spread**2 + alone)
        weight /= weight.sum(axis=0)
        edge = (weight * at).sum(axis=0)
        with np.errstate(divide="ignore"):
            log = np.log(self.share.ravel())
        one_edge, misfit = _one_edge_log(at, spread, alike, alone)
        birge = float(misfit[(log + one_edge).argmax()]) / (len(views) - 1)  # passes may lie farther apart
        if birge > 1.0:
            one_edge, _ = _one_edge_log(at, spread, alike, alone * birge)
        share = shares(log + one_edge)
        mean = float(share @ edge)
        together = weight * spread
        common = (together * (alike @ together)).sum(axis=0)
        apart = (weight * (at - edge) ** 2).sum(axis=0)
        explained = (weight * (1.0 - weight) * alone + together * spread).sum(axis=0) - common
        left = (edge - mean) ** 2 + common + np.maximum(apart - CHANCE**2 * explained, 0.0)
        beyond, u = self.beyond_mm.copy(), self.u_mm.copy()
        for (on, _), begin in zip(views, place[:, 0], strict=True):
            beyond[on], u[on] = mean - begin, math.sqrt(float(share @ left))
        for on, seen in apart_from_these:
            beyond[on], u[on] = beyond_of(share, seen)
        beyond += self.own_mm
        return replace(self, beyond_mm=beyond, together_u_mm=u, share=share.reshape(self.share.shape))


def _one_edge_log(at: Float, spread: Float, alike: Float, alone: Float) -> tuple[Float, Float]:
    """Log-likelihoods (t,) of v views that see one edge at `at` (v, t), mm, wherever it is, and their misfits.

    spread (v, t): standard deviations of what they do not see, correlated between views by alike (v, v); alone (v, 1):
    variances of what each errs by itself.
    """
    covariance = spread.T[:, :, None] * spread.T[:, None, :] * alike + np.diag(alone[:, 0])
    weight = np.linalg.inv(covariance)
    total = weight.sum(axis=(1, 2))
    pull = (weight @ at.T[..., None])[..., 0]
    misfit = (at.T * pull).sum(axis=1) - pull.sum(axis=1) ** 2 / total
    return -0.5 * (misfit + np.linalg.slogdet(covariance)[1] + np.log(total)), misfit


def _common_views(known: Bool) -> list[int]:
    """Of views that know some cells (v, c) those that lie beside each other, from the two that share most on; or none.

    A pass of another part of the edge, or a frame or two that show a corner, say nothing of where the others end.
    """
    both = np.triu(known.astype(np.int64) @ known.T, 1)
    kept = [int(k) for k in np.unravel_index(both.argmax(), both.shape)]
    for k in np.argsort(-known.sum(axis=1), kind="stable"):
        if k not in kept and known[[*kept, k]].all(axis=0).sum() >= LEAST_SHARED:
            kept.append(int(k))
    return sorted(kept) if both.max() >= LEAST_SHARED else []


def _by_cells(cell: Int, values: Float, count: int) -> Float:
    """Medians (count,) of values (n,) by the number of their cell (n,); NaN of an empty one."""
    order = np.argsort(cell, kind="stable")
    return medians(values[order], np.searchsorted(cell[order], np.arange(count + 1)))


def broken_end(
    cloud: Cloud,
    rim: FaceRim,
    here: Bool,
    condition: EdgeCondition = "unknown",
    corner: LowerFillet | None = None,
) -> BrokenEnd:
    """The lower end of a face in the frames `here` (N,), by the depths of its last returns in all passes.

    And by its corner with the lower surface, where other frames show both. A declared sharp end that the returns
    contradict counts as an unknown one.

    Source: eq. (12) and (12a) of docs/method.md for the templates; averaged over them as Hoeting et al., Bayesian model
    averaging, Statistical Science 14 (1999), 382.
    """
    beyond, u, own = np.zeros((3, here.size))
    numbers = np.unique(cloud.pass_index[here])
    footprints = _footprints(cloud, rim, here)
    burr = drawn_end(cloud, rim, here)
    looks = [_view(cloud, rim, here & (cloud.pass_index == p), burr.is_proven, footprints) for p in numbers]
    views = [view for view, _ in looks]
    prior = PRIORS[condition]
    templates = end_templates(prior)
    seen, likelihood, share = _posterior(views, templates, corner)
    if _contradicted(condition, views, corner, likelihood + templates.log_prior):
        return replace(broken_end(cloud, rim, here, "unknown", corner), contradicts=True)
    if seen:
        templates = templates.finer(
            share.sum(axis=1) > UNLIKELY, math.log(prior.most_mm / prior.least_mm) / (SIZES - 1)
        )
        views = [view._replace(pixels=_likely(view, one, share)) for view, one in zip(views, seen, strict=True)]
        seen, likelihood, share = _posterior(views, templates, corner)
    possible, of_size = np.isfinite(templates.log_prior[1:]), share.sum(axis=1)
    proven = bool(likelihood[1:][possible].max() - likelihood[0] > PROOF)
    rims = [0.0]
    for p, (view, shown), one in zip(numbers, looks, seen, strict=True):
        mine = here & (cloud.pass_index == p)
        mean, spread = beyond_of(share, one)
        broken = float(of_size[templates.size_mm > 0.0].sum())
        unseen = max(mean / broken - view.further * view.step_mm, 0.0) if broken > 0.0 else 0.0
        own[mine] = broken * _own_break(cloud, rim, shown, unseen, np.flatnonzero(mine))
        beyond[mine], u[mine] = mean + own[mine], spread
        deep = np.tensordot(share, one.fall) > 3.0 * np.sqrt(np.diag(view.known.noise))
        rims.append(float(np.diff(view.edges_mm)[deep].sum()) * math.cos(view.inclination))
    size, rim_mm = (float(of_size @ templates.size_mm), max(rims)) if proven and seen else (0.0, 0.0)
    if corner is not None:
        size, rim_mm = max(size, corner.radius_mm), max(rim_mm, corner.rim_mm)
    hidden = np.where(here, _hidden_end_u_mm(cloud, rim.face), 0.0)
    drawn = burr.beside(here) if burr.rim_mm > 0.0 else None
    rim_mm = max(rim_mm, burr.rim_mm)
    return BrokenEnd(beyond, u, hidden, size, rim_mm, u, share, dict(zip(numbers, seen, strict=True)), own, drawn)


def _posterior(
    views: Sequence[EndView], templates: EndTemplates, corner: LowerFillet | None
) -> tuple[list[SeenEnd], Float, Float]:
    """The templates as all passes see them, their log-likelihoods (t,), and their shares by incidence (t, i)."""
    seen = [seen_end(view, templates) for view in views]
    by_corner = np.zeros(templates.size_mm.size) if corner is None else _corner_log(templates, corner)
    log = by_corner[:, None] + together_log(seen)
    share = shares((templates.log_prior[:, None] + log).ravel())
    return seen, np.logaddexp.reduce(log, axis=1), share.reshape(log.shape)


def _contradicted(condition: EdgeCondition, views: Sequence[EndView], corner: LowerFillet | None, log: Float) -> bool:
    """Whether returns prove an end of any size against one that was declared sharp; log (t,): of that, with priors."""
    if condition != "sharp" or not views:
        return False
    templates = end_templates(PRIORS["unknown"])
    other = _posterior(views, templates, corner)[1] + templates.log_prior
    return bool(np.logaddexp.reduce(other) - np.logaddexp.reduce(log) > PROOF)


def _likely(view: EndView, seen: SeenEnd, share: Float) -> Pixels:
    """The pixels that a pass leaves possible, by the shares of the templates (t, i)."""
    return view.pixels.of(np.tensordot(share, seen.pixel) > NEGLIGIBLE)


def together_log(seen: Sequence[SeenEnd]) -> Float:
    """Log-likelihoods (t, i), but for a constant, of what all passes show: of one sensor, with one incidence."""
    return np.log(INCIDENCE_PRIOR) + sum(one.log for one in seen)


class EndFrames(NamedTuple):
    """What single frames of a pass show of the end."""

    frames: Shaped[Int, " k"]
    further_mm: Shaped[Float, " k"]  # how far their returns go on beyond those on the line
    depth: Shaped[Float, "k g"]  # of the groups between the limits `edges_mm`, under the line
    edges_mm: Shaped[Float, " g1"]


def _own_break(cloud: Cloud, rim: FaceRim, shown: EndFrames, unseen_mm: float, frames: Int) -> Float:
    """How far the virtual edge lies beyond the returns of frames (k,) of a pass, more than on average over it, mm.

    A brush or a file breaks an edge more here than there. Each frame shows how far its returns go on beyond the line,
    and by their depth how large the break is, to which the part that is not seen (on average `unseen_mm`) is in
    proportion: breaks of one form differ by their scale. Both run smoothly along the edge. Where the view sways, so
    does what returns of one and the same break.

    Source: eq. (12d) of docs/method.md.
    """
    if len(shown.frames) < LEAST_FRAMES:
        return np.zeros(frames.size)
    mean = shown.depth.mean(axis=0)
    middle = 0.5 * (shown.edges_mm[1:] + shown.edges_mm[:-1])
    grows = mean - middle * np.gradient(mean, middle)  # by the logarithm of the scale
    noise = 0.5 * np.cov(np.diff(shown.depth, axis=0).T) + DEPTH_U_MM**2 * np.eye(mean.size)
    gain = np.linalg.solve(noise + free_depths(shown.edges_mm), grows)
    information = float(grows @ gain)
    scale = (shown.depth - mean) @ gain / (information + 1.0 / (len(shown.depth) * USUALLY_WITHIN**2))
    value = shown.further_mm + unseen_mm * scale
    lean = np.arctan(rim.recession(shown.frames))
    lean -= lean.mean()
    off = value - np.median(value)
    most = FAR * np.median(np.abs(off))
    usual = np.clip(off, -most, most)  # where the end is lost it is not by the view
    value -= lean * float(lean @ usual) / float(lean @ lean + lean.size * STEADY**2)
    place = in_planes(cloud.base_from_profiler, rim.end_x_mm, rim.face.z(rim.end_x_mm))[shown.frames]
    s = arc_lengths_mm(place)
    course = fit_course(s, value)
    level, varies = float(course.value(s).mean()), float(course.value(s).var())
    proven = max(1.0 - float((course.u(s) ** 2).mean()) / varies, 0.0) if varies > 0.0 else 0.0
    return np.asarray(proven * (course.value(np.interp(frames, shown.frames, s)) - level))


def _corner_log(templates: EndTemplates, corner: LowerFillet) -> Float:
    """Log-likelihoods (t,) of the depth under both lines where it is the same, of a corner that turns by 2 h.

    Of a rounding r (1 - cos h), of a chamfer of height c, turned by tau, c / (1 + sin tau / sin(2 h - tau)).
    """
    size, turn = templates.size_mm, templates.turn
    round_ = turn == 0.0
    ahead = np.sin(np.clip(2.0 * corner.half_turn - turn, 0.0, math.pi))
    with np.errstate(divide="ignore"):
        depth = size * np.where(round_, 1.0 - math.cos(corner.half_turn), ahead / (ahead + np.sin(turn)))
    sharp_u = corner.depth_u_mm + DEPTH_U_MM
    u = np.hypot(sharp_u**2 / (sharp_u + depth), QUARTER * depth)  # returns lie on the arc, too
    return np.asarray(-0.5 * ((corner.depth_mm - depth) / u) ** 2 - np.log(u))


def weights(s: Float, u_mm: Float) -> Float:
    """What each frame (N,) at s (N,) mm counts, by what it does not see of the break beside those within CELL_MM.

    1 for those that see most of it: a pass that sees the corner fixes the edge where it covers it.
    """
    on, out = np.isfinite(s), np.zeros(s.size)
    if on.any():
        cell = stretches(s[on], CELL_MM)
        least = np.full(int(cell.max()) + 1, np.inf)
        np.minimum.at(least, cell, u_mm[on])
        out[on] = (least[cell] ** 2 + ALIKE_MM**2) / (u_mm[on] ** 2 + ALIKE_MM**2)
    return out


def beyond_of(share: Float, seen: SeenEnd) -> tuple[float, float]:
    """Virtual edge beyond the last return, mm, and its standard uncertainty, by the posterior over the templates."""
    share, value, u = share.ravel(), seen.beyond.ravel(), seen.beyond_u.ravel()
    mean = float(share @ value)
    return mean, math.sqrt(float(share @ ((value - mean) ** 2 + u**2)))


def whole_end(frames: int) -> BrokenEnd:
    """The end of a face of which nothing is broken."""
    none = np.zeros(frames)
    return BrokenEnd(none, none, none, 0.0, 0.0, none, np.ones((1, 1)), {}, none)


def together_along(s: Float, doubt_mm: Float, at: Float, *values: Float | Bool) -> tuple[Float, ...]:
    """What frames at s (N,), that do not see `doubt_mm` (N,) of the end, have together at stations (k,), by `weights`.

    values: (N,) each. NaN in s: none.
    """
    on = np.isfinite(s)
    cell, weight = np.clip(np.searchsorted(at, s[on]), 0, at.size - 1), weights(s[on], doubt_mm[on])
    total = np.bincount(cell, weight, at.size)
    known = total > 0.0
    sums = [np.bincount(cell, weight * of[on], at.size)[known] for of in values]
    return tuple(np.interp(at, at[known], of / total[known]) for of in sums)


def _footprints(cloud: Cloud, rim: FaceRim, here: Bool) -> Float:
    """Shares of FOOTPRINTS (f,), by what is cut off the corner of both faces in the columns that see it.

    Over a footprint of 2 h columns, a fold k of the depth is on average k (h^3 - (h - 1/2)^3) / (6 h) off its lines in
    columns within half of one. Another brightness or another part of the sheet beyond it changes that by as much.
    """
    half = 0.5 * FOOTPRINTS
    wide = np.maximum(half, 0.5)
    cut = np.where(half > 0.5, (wide**3 - (wide - 0.5) ** 3) / (6.0 * wide), half**2 / 6.0)
    log = np.zeros(half.size)
    if rim.adjacent is None:
        return ANY_FOOTPRINT
    for one in np.unique(cloud.pass_index[here]):
        blunt, u = _bluntness(cloud, rim, rim.adjacent, here & (cloud.pass_index == one))
        spread = np.hypot(u, CUT_SPREAD * cut)
        log += np.log((1.0 - WORN) * np.exp(-0.5 * ((blunt - cut) / spread) ** 2) / spread + WORN)
    return shares(log)


def _bluntness(cloud: Cloud, rim: FaceRim, adjacent: FaceLines, here: Bool) -> tuple[float, float]:
    """What is cut off the corner of two faces in the columns that see it, in columns times the fold; and its u."""
    face, frames = rim.face, sampled(here & (np.minimum(rim.face.count, adjacent.count) > LEAST_GROUPS))
    if frames.size < LEAST_FRAMES:
        return 0.0, 1.0
    x = cloud.x_mm[frames].astype(np.float64)
    fold = (adjacent.slope - face.slope)[frames]
    corner = face.crossing(adjacent)[frames]
    lines = [
        of.z_mean[frames, None] + of.slope[frames, None] * (x - of.x_mean[frames, None]) for of in (face, adjacent)
    ]
    pitch = column_pitch_mm(cloud.x_mm[frames])
    way = (x - corner[:, None]) * rim.side[frames, None] / pitch
    off = (np.where(way > 0.0, *lines) - cloud.z_mm[frames]) / (rim.side[frames] * fold * pitch)[:, None]
    shown = cloud.keep[frames] & np.isfinite(off)
    at, around = off[shown & (np.abs(way) < 0.5)], off[shown & (np.abs(np.abs(way) - 0.75 * AROUND) < 0.25 * AROUND)]
    if min(at.size, around.size) < LEAST_FRAMES:
        return 0.0, 1.0
    at, around = (np.clip(of, *np.quantile(of, [0.05, 0.95])) for of in (at, around))
    return float(at.mean() - around.mean()), math.hypot(float(at.std()) / math.sqrt(at.size), CUT_U)


def _view(cloud: Cloud, rim: FaceRim, here: Bool, burred: Bool, footprints: Float) -> tuple[EndView, EndFrames]:
    """What the frames `here` (N,) of a pass show of the break, where no burr hides it (N,)."""
    face = rim.face
    frames = sampled(here & ~burred & (face.count > LEAST_GROUPS) & (face.sxx > 0.0))
    if frames.size < LEAST_FRAMES:
        frames = np.flatnonzero(here & (face.sxx > 0.0))
        step = float(np.median(rim.step_mm[frames])) if frames.size else 0.05
        slope = float(np.median(rim.recession(frames))) if frames.size else 1.0
        edges = np.arange(LEAST_GROUPS + 1.0) * step
        unknown = _nothing_known(LEAST_GROUPS)
        phases = end_phases(True)
        pixels = possible_pixels(len(phases), footprints)
        view = EndView(unknown, edges, math.atan(slope), step, phases, 0.0, 0.0, pixels)
        return view, EndFrames(frames[:0], np.zeros(0), np.zeros((0, LEAST_GROUPS)), edges)
    step = float(np.median(rim.step_mm[frames]))
    slope = float(np.median(rim.recession(frames)))
    width = float(np.median(np.sqrt(12.0 * face.sxx[frames] / face.count[frames]))) + rim.left_out_mm
    width *= math.hypot(1.0, slope)
    further = 0.0
    for _ in range(2):  # groups reach over what nearly all frames show broken, as far back as the face was straight
        edges = end_groups(min(width, DEEP_MM) / step + further)
        depth, last = last_returns(cloud, rim, frames, edges)
        further = float(np.percentile(last[:, 0], 5.0))
    # The lower surface may return in many of the frames: these say nothing of how the edge is broken.
    usual = float(np.percentile(last[:, 0], 25.0))
    alike = last[:, 0] <= 2.0 * usual + ONWARD[-1]
    if usual >= LEAST_GROUPS:  # of a break that many columns show, how deep the last of them lies tells it, too
        deep = np.nan_to_num(depth[:, 0])
        alike &= deep <= 2.0 * max(float(np.percentile(deep, 25.0)), 0.0) + ONWARD[-1] * step
    depth = depth[alike]
    mostly = np.append(np.isfinite(depth).mean(axis=0) > 0.5, False)
    depth = depth[:, : int(mostly.argmin())]
    whole = np.isfinite(depth).all(axis=1)
    depth, usual_frames = depth[whole], np.flatnonzero(alike)[whole]
    is_shown = len(depth) >= LEAST_FRAMES and depth.shape[1] >= LEAST_GROUPS
    edges = edges[: depth.shape[1] + 1] if is_shown else edges[: LEAST_GROUPS + 1]
    known = _known_depths(depth, edges * step) if is_shown else _nothing_known(edges.size - 1)
    moved = float(np.diff(np.percentile(rim.end_x_mm[frames], [5.0, 95.0]))[0]) * math.hypot(1.0, slope) / step
    further = float(last[alike, 0].mean())
    if not rim.on_line:  # a return under the line lies that much farther along the face
        further -= float(np.nanmean(last[alike, 1])) * slope / step
    moving = moved > STILL
    phases, lean = end_phases(moving), math.atan(slope)
    pixels = possible_pixels(len(phases), footprints, _fills(cloud, rim, frames, moving))
    incidences = _incidences(cloud, rim, frames, lean)
    view = EndView(known, edges * step, lean, step, phases, further, usual, pixels, incidences)
    singly = usual_frames if is_shown else usual_frames[:0]
    return view, EndFrames(frames[singly], last[singly, 0] * step, depth[: singly.size], edges * step)


def _incidences(cloud: Cloud, rim: FaceRim, frames: Int, lean: float) -> Float:
    """Probability (i,), under each of INCIDENCES, that the surface square to the face does not return, as is seen.

    The face beside it ends in columns that are dark in these frames and live in others.
    """
    if rim.upper is None or rim.adjacent is None or (rim.upper.count[frames] > 2).mean() > SELDOM:
        return ALL_RETURN
    if not _ends_in_the_dark(cloud, rim.adjacent, rim.face, frames):
        return ALL_RETURN
    return np.asarray(OTHERWISE + (1.0 - OTHERWISE) * (1.0 - reaches(0.5 * math.pi - lean)))


def _ends_in_the_dark(cloud: Cloud, adjacent: FaceLines, face: FaceLines, frames: Int) -> bool:
    """Whether nothing returns beyond what stands beside a face, on its other side, though columns there are live."""
    frames = frames[adjacent.count[frames] > 2]
    if frames.size < LEAST_FRAMES:
        return False
    rises = adjacent.columns[frames].sum(axis=1) > face.columns[frames].sum(axis=1)
    last = np.where(rises, adjacent.columns[frames, 1], -adjacent.columns[frames, 0])
    beyond = np.abs(last)[:, None] + np.where(rises, 1, -1)[:, None] * DARK_COLUMNS
    inside = ((beyond >= 0) & (beyond < cloud.keep.shape[1])).all(axis=1)
    if inside.sum() < LEAST_FRAMES:
        return False
    frames, last = frames[inside], last[inside]
    shown = float(np.take_along_axis(cloud.keep[frames], beyond[inside], axis=1).mean())
    return shown < SELDOM and float(dark_beyond(cloud.z_mm[frames], cloud.keep[frames], last).mean()) < 0.5


def _fills(cloud: Cloud, rim: FaceRim, frames: Int, moving: bool) -> Float:
    """Fills from which on a pixel that sees a face's end in part returns the face, and their shares (m, 2).

    A pixel asks for as much light as the faintest returns of the pass have. Where something stands apart in the next
    column, a pixel that sees both returns what gives it more light, or what is brighter, however little of it.

    moving: the end comes to lie anywhere within a column; else it fills the same share of its pixel in all frames.
    """
    face, x = rim.face, cloud.x_mm[frames]
    column, returned = np.arange(x.shape[1]), np.isfinite(cloud.z_mm[frames])
    first, last = face.columns[frames].T
    slope = face.slope[frames, None]
    off = np.abs(cloud.z_mm[frames] - face.z_mean[frames, None] - slope * (x - face.x_mean[frames, None]))
    apart = off > (STEP_MM + 2.0 * rim.step_mm[frames, None]) * np.hypot(1.0, slope)
    end = np.where(returned & ~apart, np.abs(x - rim.end_x_mm[frames, None]), np.inf).argmin(axis=1)
    beyond = np.where(2 * end > first + last, 1, -1)[:, None] * (column - end[:, None])
    behind = returned & apart & (beyond > 0)
    rivalled = float((behind & (beyond == 1)).any(axis=1).mean())
    out = np.stack([FILLS, (1.0 - rivalled) * ALONE + rivalled / FILLS.size], axis=1)
    if cloud.intensity is not None and moving:
        light = cloud.intensity[frames]
        on_face = returned & (column >= first[:, None]) & (column < last[:, None])
        by_light = _fills_by_light(light[returned], light[on_face], light[behind & (beyond > 2) & (beyond < 5)])
        if by_light is not None:
            shares = np.array([1.0 - rivalled, 0.5 * rivalled, 0.5 * rivalled])
            out[:, 1] *= NO_LIGHT
            out = np.concatenate([out, np.stack([by_light, (1.0 - NO_LIGHT) * shares], axis=1)])
    out = out[out[:, 1] > UNLIKELY]
    return np.asarray(out / [1.0, out[:, 1].sum()])


def _fills_by_light(light: AnyArray, on_face: AnyArray, rival: AnyArray) -> Float | None:
    """Fills by the light of all returns, of those on a face, and of what lies behind its end: (3,); None: unknown.

    Where nothing rivals; where a pixel returns what gives it more light; where it returns the brighter, however little.
    """
    usual = float(np.median(on_face)) if on_face.size else 0.0
    faintest = min(float(np.quantile(light, FAINTEST)) / usual, 1.0) if usual > 0.0 else 0.0
    if not faintest > 0.0 or not usual < light.max():
        return None  # the brightness is the same everywhere, or saturates
    other = float(np.median(rival)) if rival.size else 0.0
    brighter = float((rival > usual).mean()) if rival.size else 0.0
    return np.array([faintest, max(faintest, other / (other + usual)), faintest + brighter * (1.0 - faintest)])


def _known_depths(depth: Float, edges_mm: Float) -> Depths:
    """Of depths (f, g) of frames, between the limits (g + 1,) mm before the last return."""
    level = np.sort(depth, axis=0)
    cut = len(depth) // 20
    mean = level[cut : len(depth) - cut].mean(axis=0)
    low, high = level[cut], level[len(depth) - 1 - cut]
    clipped = np.clip(depth, low, high)
    noise = np.cov(clipped.T) * _alike(clipped) / len(depth)
    noise = noise + pattern_noise(mean, noise, edges_mm)
    return Depths(mean, noise, free_depths(edges_mm))


def _alike(values: Float) -> float:
    """How many neighbouring frames count as one, since they share their errors (roughness), of values (f, g) in order.

    By how means of 2, 4, 8, ... frames scatter against single ones; as long as LEAST_MEANS of them are left.
    """
    single, size, most = values.var(axis=0, ddof=1), 2, 1.0
    while (count := len(values) // size) >= LEAST_MEANS:
        both = [of.reshape(count, size, -1).mean(axis=1) for of in (values[: count * size], values[-count * size :])]
        scatter = np.mean([means.var(axis=0, ddof=1) for means in both], axis=0)  # whichever end comes first
        most = max(most, size * float(np.mean(scatter / np.maximum(single, 1e-18))))
        size *= 2
    return most


def _nothing_known(groups: int) -> Depths:
    return Depths(np.zeros(groups), np.eye(groups), np.zeros((groups, groups)))


def _hidden_end_u_mm(cloud: Cloud, face: FaceLines) -> float:
    """Standard uncertainty of where a face ends, mm, by columns that do not show it (`hidden_columns_u`)."""
    columns = hidden_columns_u(cloud.checks)
    if not columns:
        return 0.0
    lean = float(np.nanmedian(face.lean))
    return columns * column_pitch_mm(cloud.x_mm) * lean
