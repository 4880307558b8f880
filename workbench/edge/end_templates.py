"""Templates of a face's broken end, and what a scanning pass would see of each (docs/method.md, eq. (12)).

An end is sharp, rounded or has a chamfer. Each such template predicts how deep the last returns lie under the face's
line, which part of the break the rays still reach, and so how far the virtual sharp edge lies beyond the last return.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from workbench.kernels import kernel
from workbench.units import Bool, Float, Int, Shaped

EdgeCondition: TypeAlias = Literal["sharp", "deburred", "unknown"]


class EdgePrior(NamedTuple):
    """What is held possible of an edge before any return is looked at: shares, and sizes alike likely in logarithm."""

    sharp: float
    rounded: float
    chamfered: float
    least_mm: float
    most_mm: float


# A milled edge that nothing was said of is as likely sharp as broken; one that a brush or a file went over has a size.
PRIORS: dict[EdgeCondition, EdgePrior] = {
    "sharp": EdgePrior(0.5, 0.5, 0.0, 0.002, 0.02),
    "deburred": EdgePrior(0.0, 0.6, 0.4, 0.03, 2.0),
    "unknown": EdgePrior(0.5, 0.48, 0.02, 0.005, 2.0),
}
SIZES, TURNS = 24, np.radians(np.arange(15.0, 80.0, 10.0))  # templates: sizes of each kind, turns of chamfers
RARE_MM = 0.15  # breaks beyond this are the rarer, the larger
# Greatest angle of incidence at which a return is kept: below 60 deg where the camera looks away from the lobe.
STEP = math.radians(6.0)
INCIDENCES = np.arange(math.radians(44.0), math.radians(89.0), STEP)
INCIDENCE_PRIOR = np.where(np.radians(60.0) > INCIDENCES, 0.1 / 3.0, 0.9 / 5.0)
ALL_RETURN = np.ones(INCIDENCES.size)
OTHERWISE = 0.03  # probability that another surface returns nothing for another reason: a skin of scale, a mask
QUARTER = 0.15  # of a depth: a rounding need be no quarter circle, a chamfer not flat
FOOTPRINTS = np.array([0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 2.6])  # columns that a pixel sees
# Fills from which on a pixel returns a face, all alike likely. A sensor that needs much more than half of a pixel's
# light mostly loses columns all over a face, by speckle; but what lies behind the end may take any pixel that sees it.
FILLS = np.arange(0.1, 1.0, 0.2)
ALONE = (FILLS < 0.6) / 3.0  # their shares where nothing behind the end may take a pixel
ANY_FOOTPRINT = np.full(FOOTPRINTS.size, 1.0 / FOOTPRINTS.size)  # shares
ANY_FILL = np.stack([FILLS, ALONE], axis=1)[ALONE > 0.0]
# Columns of the lower surface that return beyond its edge, where the view reaches under the plate.
ONWARD = np.array([0.0, 0.5, 1.0, 2.0, 4.0])
WITHIN = np.array([-0.8, -0.4, 0.0, 0.4, 0.8])  # places within a pixel
PLACE_MM, TURN_MM, BOW_MM = 0.3, 0.3, 0.05  # by which the line and a bow may lie off the face without a break
ROUNDING = 1e-9  # mm; pixels and places within a column meet in their ends: no digit may tell on which side
# Where only a side of a thick sheet of light meets the end, pixels there are off, by columns from a pixel's middle to
# the middle of what it sees: the standard deviation, and the share of the sensors in which they are.
HOOK_MM, HOOKED = 0.02, 0.12
# The last returns, up to LAST columns, may be offset together as no break has them: by how much, in how many views.
OFFSET_MM, OFFSET, LAST = 0.004, 0.03, 10
HALVED = 12  # times, to find how much of an arc gives enough light
LAMBERT, SELDOM = 0.5, 0.02  # share of the sensors that weigh what a pixel sees by its light; of the likeliest pixel


class EndTemplates(NamedTuple):
    """T ends of a face: a sharp one first, roundings, chamfers."""

    log_prior: Shaped[Float, " t"]
    size_mm: Shaped[Float, " t"]  # radius of a rounding, height of a chamfer
    turn: Shaped[Float, " t"]  # of a chamfer from the face, rad; 0: no chamfer

    def of(self, which: Int) -> EndTemplates:
        """Some of them; the sharp one keeps its share, the others theirs together."""
        log = self.log_prior[which]
        some, every = np.exp(log[1:]).sum(), np.exp(self.log_prior[1:]).sum()
        log[1:] += math.log(every / some) if some > 0.0 else 0.0
        return EndTemplates(log, self.size_mm[which], self.turn[which])

    def finer(self, likely: Bool, step: float) -> EndTemplates:
        """The sharp end, and the `likely` (t,) others cut in three by size, a `step` of its logarithm, and by turn."""
        third = np.array([-1.0, 0.0, 1.0]) / 3.0
        out = [(self.log_prior[:1], self.size_mm[:1], self.turn[:1])]
        for is_chamfer, turns in ((False, np.zeros(1)), (True, third * (TURNS[1] - TURNS[0]))):
            of = np.flatnonzero(likely & (self.size_mm > 0.0) & ((self.turn > 0.0) == is_chamfer))
            which, size, turn = (a.ravel() for a in np.meshgrid(of, third * step, turns, indexing="ij"))
            parts = third.size * turns.size
            out.append(
                (self.log_prior[which] - math.log(parts), self.size_mm[which] * np.exp(size), self.turn[which] + turn)
            )
        return EndTemplates(*(np.concatenate(column) for column in zip(*out, strict=True)))


def end_templates(prior: EdgePrior) -> EndTemplates:
    """All that a prior holds possible."""
    sizes = np.geomspace(prior.least_mm, prior.most_mm, SIZES)
    usual = np.minimum(1.0, (RARE_MM / sizes) ** 3)
    usual /= usual.sum()
    size = np.concatenate([[0.0], sizes, np.tile(sizes, TURNS.size)])
    turn = np.concatenate([np.zeros(1 + SIZES), np.repeat(TURNS, SIZES)])
    share = np.concatenate(
        [[prior.sharp], prior.rounded * usual, np.tile(prior.chamfered * usual / TURNS.size, TURNS.size)]
    )
    with np.errstate(divide="ignore"):
        return EndTemplates(np.log(share), size, turn)


class Depths(NamedTuple):
    """What the last returns of a face lie under its line, by groups of columns from the last one on."""

    mean: Shaped[Float, " g"]  # mm
    noise: Shaped[Float, "g g"]  # covariance by noise and what patterns of the sensor may feign
    # covariance of what says nothing of a rounding: the line's own place and turn, and a bow
    free: Shaped[Float, "g g"]


def free_depths(edges_mm: Shaped[Float, " g1"]) -> Shaped[Float, "g g"]:
    """Covariance of what says nothing of a break, between groups of columns: the line's place and turn, and a bow."""
    middle = 0.5 * (edges_mm[1:] + edges_mm[:-1])
    t = 2.0 * middle / edges_mm[-1] - 1.0
    shapes = np.stack([np.ones_like(t), t, t * t - 1.0 / 3.0], axis=1) * [PLACE_MM, TURN_MM, BOW_MM]
    return np.asarray(shapes @ shapes.T)


class Pixels(NamedTuple):
    """What pixels of a sensor may be, and where the end lies in the last of them: k possibilities.

    Columns that one sees; how many of the face give it enough light to return; 1: it returns the mean depth by the
    light of what it sees (Lambert's cosine law), 0: by its length. Where both stand, the latter is just before.
    """

    sees: Shaped[Float, "k 3"]
    phase: Shaped[Int, " k"]  # of the places of the end within its column that the view has
    share: Shaped[Float, " k"]

    def of(self, which: Bool) -> Pixels:
        """Some of them (k,)."""
        return Pixels(self.sees[which], self.phase[which], self.share[which] / self.share[which].sum())


def possible_pixels(
    phases: int,
    footprints: Shaped[Float, " f"] = ANY_FOOTPRINT,
    fills: Shaped[Float, "m 2"] = ANY_FILL,
) -> Pixels:
    """By shares of FOOTPRINTS, by fills from which on a pixel that the face fills in part returns it, and theirs.

    phases: so many places of the end within its column are alike likely.
    """
    wide, fill = (a.ravel() for a in np.meshgrid(FOOTPRINTS[1:], fills[:, 0], indexing="ij"))
    prior = np.outer(footprints[1:], fills[:, 1]).ravel()
    kept = np.repeat(np.flatnonzero(prior > SELDOM * prior.max()), 2)  # each by its length, then by its light
    law = np.arange(kept.size) % 2.0
    sees = np.concatenate([np.zeros((1, 3)), np.stack([wide[kept], (wide * fill)[kept], law], axis=1)])
    share = np.append(footprints[0], prior[kept] * np.where(law > 0.0, LAMBERT, 1.0 - LAMBERT))
    share = np.tile(share / (share.sum() * phases), phases)
    return Pixels(np.tile(sees, (phases, 1)), np.repeat(np.arange(phases), len(sees)), share)


class EndView(NamedTuple):
    """What one pass shows of the end: depths by groups of columns before the last return."""

    known: Depths
    edges_mm: Shaped[Float, " g1"]
    inclination: float  # of the face to the rays' normal, rad; negative: its end is the nearer one
    step_mm: float
    phases: Shaped[Float, "p q"]  # places of the end within its column; p alike likely, each the mean over q
    further: float  # columns beyond the line's end in which returns go on, on average
    usually_further: float  # the same in the lower quartile of the frames
    pixels: Pixels
    incidences: Shaped[Float, " i"] = ALL_RETURN  # how likely what the pass shows is under each of INCIDENCES

    @property
    def nearer(self) -> float:
        """What a return lies nearer to the sensor than the face, by how far before its pixel's middle it was seen."""
        return math.sin(self.inclination) * math.cos(self.inclination)


def end_phases(moving: bool) -> Float:
    """Places (p, q) of the end within its column; p alike likely, each the mean over q: all in turn where it moves."""
    return (np.arange(12.0)[None] + 0.5) / 12.0 if moving else (np.arange(6.0)[:, None] + 0.5) / 6.0


def reaches(incidence: float) -> Float:
    """Whether a surface at this incidence, rad, returns under each of INCIDENCES (i,): 0 to 1, over a STEP."""
    return np.clip((INCIDENCES - incidence) / STEP + 0.5, 0.0, 1.0)


class SeenEnd(NamedTuple):
    """T templates as one pass sees them under each of INCIDENCES."""

    log: Shaped[Float, "t i"]  # log-likelihood of all that the pass shows
    beyond: Shaped[Float, "t i"]  # of the virtual edge from where the returns on the line end, mm: mean
    beyond_u: Shaped[Float, "t i"]  # and standard deviation, by what the sensor still returns
    fall: Shaped[Float, "t i g"]  # depth under the line by groups of columns, mm
    pixel: Shaped[Float, "t i k"]  # shares of the view's pixels
    inclination: float  # of the face to the rays' normal, rad


def seen_end(view: EndView, templates: EndTemplates) -> SeenEnd:
    """Every template under every greatest incidence, on average over places within the column and pixels.

    And over how far the lower surface returns, where it does.
    """
    under = 0.5 * math.pi + view.inclination < INCIDENCES  # the lower surface returns
    onward = (ONWARD if under[-1] else ONWARD[:1]) * view.step_mm
    log = np.zeros((templates.size_mm.size, under.size, onward.size))
    log[:, ~under, 0] = math.log(onward.size)
    log[:, ~under, 1:] = -np.inf
    size, turn = templates.size_mm[:, None, None], templates.turn[:, None, None]
    shown = _shown_mm(view, size, turn, INCIDENCES[:, None]) + onward
    # Where nothing of a break is seen, returns are those of a sharp end in the same place.
    is_seen = (shown > 0.0) & np.isfinite(log)
    is_seen[0, 0, 0] = True
    # What a greater incidence shows no more of looks the same, as a chamfer, which is seen whole or not at all.
    is_new = is_seen.copy()
    is_new[:, 1:] &= ~is_seen[:, :-1] | (shown[:, 1:] != shown[:, :-1])
    look = np.zeros(shown.shape, np.int64)
    look[is_new] = np.arange(is_new.sum())
    look = np.maximum.accumulate(look, axis=1)
    looks = [np.broadcast_to(of, shown.shape)[is_new] for of in (size, turn, INCIDENCES[:, None], onward)]
    one = _looked(view, looks)
    log += one.log[look]
    goes_on = size + onward > 0.0
    beyond = np.where(goes_on, size - shown + view.further * view.step_mm, 0.0) - one.past[look]
    beyond_u = np.hypot(
        np.where(goes_on, QUARTER * (size - shown), view.usually_further * view.step_mm), one.past_u[look]
    )
    most = log.max(axis=2, keepdims=True)
    weight = np.exp(log - most)
    total = weight.sum(axis=2, keepdims=True)
    weight /= total
    mean = (weight * beyond).sum(axis=2)
    spread = np.sqrt((weight * ((beyond - mean[..., None]) ** 2 + beyond_u**2)).sum(axis=2))
    evidence = (most + np.log(total / onward.size))[..., 0]
    evidence += np.log(view.incidences * np.clip(reaches(view.inclination), 1e-6, 1.0))  # the face returns
    fall, pixel = (np.einsum("tio,tiog->tig", weight, of[look]) for of in (one.fall, one.pixel))
    return SeenEnd(evidence, mean, spread, fall, pixel, view.inclination)


class _Looked(NamedTuple):
    """V templates at one incidence each, averaged over the pixels and the places of the end within its column."""

    log: Shaped[Float, " v"]  # log-likelihood of the depths
    past: Shaped[Float, " v"]  # how far the last return lies beyond the end of the returns, mm: mean
    past_u: Shaped[Float, " v"]  # and standard deviation
    fall: Shaped[Float, "v g"]
    pixel: Shaped[Float, "v k"]


def _looked(view: EndView, looks: list[Float]) -> _Looked:
    """looks (v,): size, turn, incidence and how far the lower surface returns, as `seen_end` has them."""
    sees, phase, prior = view.pixels
    shape = looks[0].size, prior.size
    of, pixel = (at.ravel() for at in np.indices(shape))
    by_light = np.append(False, (sees[1:, :2] == sees[:-1, :2]).all(axis=1) & (phase[1:] == phase[:-1]))
    once = ~by_light[pixel] | (looks[1][of] == 0.0)  # a flat chamfer is as bright all over: both pixels see the same
    at = np.cumsum(once) - 1
    of, pixel = of[once], pixel[once]
    size, turn, incidence, onward = (one[of] for one in looks)
    fall, shift, past = rendered_end(view, size, turn, incidence, pixel, onward)
    seen = fall - shift * view.nearer
    covariance, own = view.known.noise + view.known.free, QUARTER * fall
    score, hooked, amount, offset = np.empty((4, of.size))
    hook = HOOK_MM / view.step_mm * shift
    _log_likelihoods(view.known.mean, covariance + _offset_ends(seen.shape[1]), seen, own, hook, offset, hooked, amount)
    _log_likelihoods(view.known.mean, covariance, seen, own, hook, score, hooked, amount)
    score = np.logaddexp(math.log(1.0 - HOOKED) + score, math.log(HOOKED) + hooked)
    seen += (HOOKED * np.exp(hooked - score) * amount)[:, None] * hook
    score = np.logaddexp(math.log(1.0 - OFFSET) + score, math.log(OFFSET) + offset)
    score, past, seen = score[at], past[at], seen[at]
    log = score.reshape(shape) + np.log(prior)
    most = log.max(axis=1, keepdims=True)
    weight = np.exp(log - most)
    total = weight.sum(axis=1, keepdims=True)
    weight /= total
    past = past.reshape(shape)
    mean = (weight * past).sum(axis=1)
    spread = np.sqrt((weight * (past - mean[:, None]) ** 2).sum(axis=1))
    fall = np.einsum("vk,vkg->vg", weight, seen.reshape(*shape, -1))
    return _Looked((most + np.log(total))[:, 0], mean, spread, fall, weight)


def _offset_ends(groups: int) -> Float:
    """Covariance (g, g) of returns that are offset together, from any of the LAST groups on, by OFFSET_MM."""
    inner = np.minimum(np.arange(groups) / LAST, 1.0)
    return np.asarray(OFFSET_MM**2 * (1.0 - np.maximum(inner[:, None], inner)))


def _shown_mm(view: EndView, size: Float, turn: Float, incidence: Float) -> Float:
    """How far along the line templates are seen: arcs to the greatest incidence, chamfers whole or not at all."""
    lean = view.inclination
    last = np.clip(incidence - lean, 0.0, math.pi / 2.0)  # turn of the circle where it is lost
    arc = np.sin(last) - (1.0 - np.cos(last)) * math.tan(lean)
    flat = np.where(turn + lean < incidence, 1.0 - np.tan(turn) * math.tan(lean), 0.0)
    return np.asarray(size * np.where(turn == 0.0, arc, flat))


def rendered_end(
    view: EndView, size: Float, turn: Float, incidence: Float, pixel: Int, onward: Float
) -> tuple[Float, Float, Float]:
    """Depths (n, g) of n templates by groups of columns, and from pixels to the middle of what they see (n, g); mm.

    And how far the middle of the last pixel lies beyond the end, (n,) mm.

    A quarter circle of radius R leaves the line and is seen up to where its normal stands at the greatest incidence to
    the ray (eq. (12)); a chamfer to its end (eq. (12a)), or not at all. A pixel returns the mean depth of what it sees:
    of one that the end fills in part, that lies before its middle. A break that is turned from the ray gives less light
    than the face (Lambert's cosine law).
    """
    lean, column = view.inclination, view.step_mm
    wide_mm, lit_mm, by_light = view.pixels.sees[pixel].T * [[column], [column], [1.0]]
    round_, seen = turn == 0.0, turn + lean < incidence
    shown = _shown_mm(view, size, turn, incidence)
    width = np.diff(view.edges_mm)
    wide = width > 1.5 * column
    within = np.where(wide[:, None], 0.5 * width[:, None], view.phases[:, None, :] * width[:, None])
    place = view.edges_mm[None, :-1, None] + within  # (p, g, q) before the last return
    falls = np.where(seen & ~round_, np.tan(turn) / np.maximum(1.0 - np.tan(turn) * math.tan(lean), 1e-3), 0.0)
    known = np.stack([np.where(round_, size, 0.0), shown + onward, falls, shown, size, by_light], axis=1)
    light = np.cos(np.minimum(turn + lean, 0.5 * math.pi)) / math.cos(lean)
    flat_mm = np.where(lit_mm < shown * light, lit_mm / np.maximum(light, 1e-3), lit_mm - shown * light + shown)
    enough_mm = np.where(round_, lit_mm, flat_mm)
    arc = round_ & (by_light > 0.0) & (shown > 0.0)
    enough_mm[arc] = _enough_of_arc_mm(size[arc], shown[arc], lit_mm[arc], lean)
    past = 0.5 * wide_mm - np.where(onward > 0.0, lit_mm, np.minimum(enough_mm, wide_mm))
    depth, shift = np.zeros((2, size.size, width.size))
    _depths(known, view.pixels.phase[pixel], place, np.stack([past, 0.5 * wide_mm], axis=1), lean, depth, shift)
    return depth, shift, past


def _enough_of_arc_mm(radius: Float, shown: Float, lit_mm: Float, lean: float) -> Float:
    """How much (n,) of the ends of arcs, along the line, gives as much light as `lit_mm` of the face; mm.

    By Lambert's law an arc gives, at the sine s of its incidence, sqrt(1 - s^2) / cos(lean) of the face's light.
    """
    rise = math.cos(lean) / np.maximum(radius, 1e-9)  # of s by place

    def integral(place: Float) -> Float:
        sine = np.clip(math.sin(lean) + rise * place, -1.0, 1.0)
        return np.asarray(0.5 * (np.arcsin(sine) + sine * np.sqrt(1.0 - sine**2)) / (rise * math.cos(lean)))

    last = integral(shown)
    low, high = np.zeros(shown.size), shown.copy()
    for _ in range(HALVED):
        middle = 0.5 * (low + high)
        enough = last - integral(shown - middle) >= lit_mm
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    all_of_it = last - integral(np.zeros(shown.size))
    return np.asarray(np.where(all_of_it > lit_mm, high, lit_mm - all_of_it + shown))


@kernel
def _depths(known: Float, phase: Int, place: Float, pixels: Float, lean: float, out: Float, shift: Float) -> None:
    """Fill in depths (n, g) under the line of n templates, known (n, 6), and `shift` (n, g) as `rendered_end` has it.

    These are the radius or 0, what is seen, the fall of a chamfer, where the lower surface begins, the size, and
    whether a pixel weighs by light.

    place (p, g, q): of the pixels' middles before the last return; pixels (n, 2): how far they reach, half their width.
    """
    sine, cosine = math.sin(lean), math.cos(lean)
    for n in range(len(known)):
        radius, shown, falls, under, size, by_light = known[n]
        past, half = pixels[n]
        for g in range(place.shape[1]):
            total, count = 0.0, 0.0
            for q in range(place.shape[2]):
                middle = place[phase[n], g, q] - past
                shift[n, g] += 0.5 * max(half - middle, 0.0) / place.shape[2]
                if middle - half > shown + ROUNDING:
                    count += WITHIN.size
                    continue
                for offset in WITHIN:
                    w = middle + offset * half
                    if w >= -ROUNDING:
                        on = max(shown - w, 0.0)
                        if on > under + ROUNDING:
                            total += (size - on) * cosine / sine
                            count += 1.0
                        elif radius > 0.0 and on > 0.0:
                            turn = min(on / radius * cosine + sine, 1.0)
                            facing = math.sqrt(1.0 - turn * turn)  # cosine of the incidence
                            light = facing / cosine if by_light > 0.0 else 1.0
                            total += light * radius * (1.0 - facing * cosine - turn * sine)
                            count += light
                        else:
                            total += falls * on
                            count += 1.0
            out[n, g] = total / max(count, 1e-9)
            if total == 0.0 and place[phase[n], g, 0] - past - half > shown + ROUNDING:
                break  # further in lies the face


@kernel
def _log_likelihoods(
    mean: Float, covariance: Float, expected: Float, u: Float, loose: Float, out: Float, hooked: Float, amount: Float
) -> None:
    """Fill in those (s,) of means (g,) with a covariance (g, g), by what is expected (s, g), each with its own u.

    `hooked` (s,): where what is loose (s, g) is added to what is expected, by a normal amount whose mean is `amount`.

    Shapes reach from the last returns inwards: behind them nothing is expected, without u. The Cholesky rows of what
    lies there stand first, and are kept from shape to shape: 1 / the diagonal, on it.
    """
    size = len(mean)
    lower, white, free = np.zeros((size, size)), np.empty(size), np.zeros(size)
    squares, root = np.zeros(size + 1), np.ones(size + 1)  # sums of rows; products of what is on the diagonal
    same = 0  # rows behind the last shape
    for n in range(len(expected)):
        behind = size
        for i in range(size):
            if u[n, i] != 0.0 or expected[n, i] != 0.0 or loose[n, i] != 0.0:
                behind = size - 1 - i
        own, both = 1.0, 0.0  # of the loose shape: 1 and its square, its product with what is left
        for i in range(min(same, behind), size):  # Cholesky, and the forward substitution with it
            row = size - 1 - i
            for j in range(i + 1):
                rest = covariance[row, size - 1 - j]
                for k in range(j):
                    rest -= lower[i, k] * lower[j, k]
                lower[i, j] = rest * lower[j, j] if j < i else 1.0 / math.sqrt(rest + u[n, row] ** 2)
            rest, also = mean[row] - expected[n, row], loose[n, row]
            for k in range(i):
                rest -= lower[i, k] * white[k]
                also -= lower[i, k] * free[k] if k >= behind else 0.0
            white[i], free[i] = rest * lower[i, i], also * lower[i, i]
            squares[i + 1], root[i + 1] = squares[i] + white[i] ** 2, root[i] * lower[i, i]
            if i >= behind:
                own, both = own + free[i] ** 2, both + free[i] * white[i]
        same = behind
        out[n], amount[n] = math.log(root[size]) - 0.5 * squares[size], both / own
        hooked[n] = out[n] - 0.5 * (math.log(own) - both * both / own)
