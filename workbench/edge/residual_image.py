"""What straight lines leave of a face in all frames together, and what that makes of its direction and its ends.

The residuals of a face are an image, frame by place on the face. What its noise does not explain, averaged over the
frames of a stretch of edge, lasts: a bow of the face, a pattern or the linearity of the sensor, a second return of a
part of it (ghost), a step. It is taken for a random walk along the face, errors of single places and a part that
stands aside as a whole; how strong they are is weighed by their restricted likelihood (Harville, JASA 72 (1977),
320), and what they make of the line follows (docs/method.md, 4).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud
from workbench.geometry.chains import FaceLines
from workbench.geometry.medians import row_medians
from workbench.units import AnyArray, Float, Int, Shaped

FRAMES, LEAST_FRAMES = 480, 4  # evenly over each pass; of a stretch at the least
STRETCH_MM, STRETCH_FRAMES = 40.0, 30  # of edge, whose frames are pooled; as long as it takes for so many
PLACES, LEAST_PLACES = 16, 5  # on a face, along it
OFTEN = 0.1  # of the frames, that a column sees a face
SHRUNK = 0.2  # of the covariance between places towards none: a few frames tell it badly
# Strengths that are alike likely before: of the walk of the range, rms over 1 lateral mm, and of single places; mm.
WALKS = np.concatenate([[0.0], np.geomspace(1e-4, 0.1, 21)])
SINGLES = np.concatenate([[0.0], np.geomspace(5e-5, 0.1, 9)])
SENSOR = 1000.0  # odds, before, that what lasts is the sensor's, with one walk for all faces
# Share, before, of no walk and of no errors of single places; strengths beyond that of good sensors are the rarer.
NOTHING, USUAL_MM = 0.5, 0.001
FREE_MM = 1.0  # by which a line may be anything
# Share, before, of faces of which a part stands aside as a whole; by how much, mm, alike likely.
PART, ASIDE_MM = 0.01, np.array([0.01, 0.03, 0.1, 0.3])
RARE = 5.0  # a likelihood smaller by a factor whose logarithm is this counts for nothing


class Linearity(NamedTuple):
    """The sensor's own error over its columns, an Ornstein-Uhlenbeck process: rms and correlation length, mm.

    What is not declared is taken for half a micrometre, the least that a face's own residuals cannot disprove, and for
    a quarter of a wave twice as long as a usual field of view.
    """

    rms_mm: float = 0.0005
    length_mm: float = 18.0

    def covariance(self, apart_mm: Float) -> Float:
        """Of the errors of two places so far apart, mm^2."""
        return np.asarray(self.rms_mm**2 * np.exp(-np.abs(apart_mm) / self.length_mm))


def declared_linearity(sensor: Path | None) -> Linearity:
    """The linearity that a `sensor.json` declares; the default where there is none, or it says nothing of it."""
    from workbench.result_files import SensorFile  # pydantic: loaded when there is something to read

    told = SensorFile() if sensor is None else SensorFile.read(sensor)
    usual = Linearity()
    return Linearity(
        usual.rms_mm if told.linearity_mm is None else told.linearity_mm, told.linearity_length_mm or usual.length_mm
    )


@dataclass(frozen=True, slots=True, eq=False)
class FaceForm:
    """What lasts makes of a face's line at m places of the edge: its errors, and what their u is."""

    turn_u: Shaped[Float, " m"]  # of its direction, rad
    lower_u_mm: Shaped[Float, " m"]  # of its place across the face at the lower end
    upper_u_mm: Shaped[Float, " m"]  # and at the upper one
    width_mm: float  # of the face, as far as its points reach
    turn: Shaped[Float, " m"]  # its slope towards the lower end that a part of the face makes which stands aside
    lower_mm: Shaped[Float, " m"]  # and its places that this makes, along the sensor's z as all of these
    upper_mm: Shaped[Float, " m"]
    aside_mm: float = 0.0  # by which a part of the face stands aside at most, as likely as it is

    @property
    def uncorrected(self) -> FaceForm:
        """The same for a line that keeps these errors."""
        turn_u, lower_u, upper_u = (
            np.hypot(u, error)
            for u, error in (
                (self.turn_u, self.turn),
                (self.lower_u_mm, self.lower_mm),
                (self.upper_u_mm, self.upper_mm),
            )
        )
        nothing = np.zeros_like(turn_u)
        return FaceForm(turn_u, lower_u, upper_u, self.width_mm, nothing, nothing, nothing)

    @property
    def offset_u_mm(self) -> Float:
        """Standard uncertainty (m,) of the face's place at one end or the other, mm."""
        return np.sqrt(0.5 * (self.lower_u_mm**2 + self.upper_u_mm**2))


class SeenBy(NamedTuple):
    """A pass that sees a face."""

    first_mm: float  # along the edge, from where
    last_mm: float
    column_mm: Shaped[Float, " p"]  # lateral places of the sensor that see the places on the face
    lean: float  # mm along the face by mm of the sensor's lateral axis


class FaceImage(NamedTuple):
    """The residual image of one face, averaged over the frames of each of k stretches of edge, pass by pass."""

    s: Shaped[Float, " k"]  # mm
    mean: Shaped[Float, "k p"]  # across the face, mm
    noise: Shaped[Float, "k p p"]  # its covariance, mm^2
    place_mm: Shaped[Float, " p"]  # along the face from its middle, towards its lower end
    lean: Shaped[Float, " k"]  # mm along the face by mm of the sensor's lateral axis
    of_pass: Shaped[Int, " k"]  # number of the pass of each stretch
    wide: int = 1  # columns a place
    passes: tuple[SeenBy, ...] = ()  # (): one, all along
    # What places leave by the sensor's columns, as wide as the places of the image that is given; None: too few.
    by_columns: Callable[[FaceImage], FaceImage | None] = lambda _: None


def face_image(
    cloud: Cloud, labels: AnyArray, face: FaceLines, label: int, side: Float, s_frames: Float
) -> FaceImage | None:
    """The residual image of the face with this label in `labels` (N, M); None: too little of it is seen.

    side (N,): its lower end lies towards rising side * x. s_frames (N,): arc length of each frame, mm.
    """
    frames = np.flatnonzero(np.isfinite(s_frames) & (face.count > LEAST_PLACES))
    of_passes = [frames[cloud.pass_index[frames] == p] for p in np.unique(cloud.pass_index[frames])]
    frames = np.concatenate([mine[_evenly(mine.size)] for mine in of_passes]) if of_passes else frames
    if frames.size < 2 * LEAST_FRAMES:
        return None
    slope = face.sxz[frames] / face.sxx[frames]
    lean = np.hypot(1.0, slope)
    on = (labels[frames] == label) & cloud.keep[frames]
    columns = np.flatnonzero(on.any(axis=0))
    part = slice(columns[0], columns[-1] + 1)
    on = on[:, part]
    dx = np.where(on, cloud.x_mm[frames, part] - face.x_mean[frames, None], 0.0)
    off = np.where(
        on, (cloud.z_mm[frames, part] - face.z_mean[frames, None] - slope[:, None] * dx) / lean[:, None], 0.0
    )
    along = dx * (side[frames] * lean)[:, None]
    half = np.sqrt(3.0) * float(np.median(np.sqrt(face.sxx[frames] / face.count[frames]) * lean))
    places = int(min(np.median(on.sum(axis=1)), PLACES))
    if places < LEAST_PLACES:
        return None
    place = np.floor((along / half + 1.0) * 0.5 * places)
    on &= (place >= 0) & (place < places)
    frame, column = np.nonzero(on)
    key = frame * places + place[frame, column].astype(np.int64)
    count = np.bincount(key, minlength=frames.size * places).reshape(-1, places)
    total = np.bincount(key, off[frame, column], minlength=frames.size * places).reshape(-1, places)
    value = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    width = 2.0 * half / places
    place_mm, s = (np.arange(places) + 0.5 - 0.5 * places) * width, s_frames[frames]
    known, group = np.unique(cloud.pass_index[frames], return_inverse=True)
    image = _pooled(value, s, place_mm, lean, group)
    if image is None:
        return None
    mean, passes = np.full(value.shape, np.nan), []
    for number in range(known.size):
        here, mine = group == number, image.of_pass == number
        if mine.any():
            mean[here] = np.stack([np.interp(s[here], image.s[mine], of) for of in image.mean[mine].T], axis=1)
        middle, sense = np.median(face.x_mean[frames][here]), np.median(side[frames][here])
        of_pass = float(np.median(lean[here]))
        passes.append(SeenBy(s[here].min(), s[here].max(), middle + sense * place_mm / of_pass, of_pass))
    left = np.full(on.shape, np.nan)
    left[frame, column] = off[frame, column] - mean[frame, place[frame, column].astype(np.int64)]
    often = on.sum(axis=0) >= OFTEN * frames.size
    wide = max(1, round(float(np.median(on.sum(axis=1))) / places))
    by_columns = partial(_patches, left[:, often], width / wide, lean)
    return image._replace(wide=wide, passes=tuple(passes), by_columns=by_columns)


def _evenly(count: int) -> Int:
    """Which of so many frames of a pass are looked at."""
    return np.unique(np.linspace(0, count - 1, min(count, FRAMES)).round().astype(np.int64))


def _patches(left: Float, column_mm: float, lean: Float, asked: FaceImage) -> FaceImage | None:
    """Patches of what places leave in frames by columns (f, n), with places as wide as those of the face asked about.

    It is fixed to the sensor: places of a wide face average out what turns a narrow one, and those of a face that moves
    in the view what stays in its column.
    """
    places = min(PLACES, left.shape[1] // asked.wide)
    if places < LEAST_PLACES:
        return None
    size = places * asked.wide
    last = left.shape[1] - size
    low = np.linspace(0, last, min(PLACES, left.shape[1] // size)).astype(np.int64)
    low = low[2 * low <= last]
    begins = np.union1d(low, last - low)  # the same from either end
    place = (np.arange(places) - 0.5 * (places - 1)) * column_mm * asked.wide
    values = (left[:, begin : begin + size].reshape(-1, places, asked.wide) for begin in begins)
    alike = np.zeros(len(left), np.int64)
    found = [_pooled(_mean(value), np.arange(len(value), dtype=float), place, lean, alike, 1) for value in values]
    known = [one for one in found if one is not None]
    if not known:
        return None
    mean, noise = (np.concatenate(parts) for parts in zip(*((one.mean, one.noise) for one in known), strict=True))
    lean = np.full(len(mean), np.median(lean))
    return FaceImage(np.zeros(lean.size), mean, noise, place, lean, np.zeros(lean.size, np.int64))


def _pooled(value: Float, s: Float, place_mm: Float, lean: Float, group: Int, most: int = 1000) -> FaceImage | None:
    """The image of residuals (f, p) of frames at s (f,), mm, by stretches of each pass, group (f,) its number."""
    passes = int(group.max()) + 1
    stretches = max(1, min(math.floor(np.ptp(s) / STRETCH_MM), len(value) // (STRETCH_FRAMES * passes), most))
    stretch = np.minimum((s - s.min()) / max(float(np.ptp(s)), 1e-9) * stretches, stretches - 1).astype(np.int64)
    stretch += group * stretches
    every = range(stretches * passes)
    keep = [k for k in every if (np.isfinite(value[stretch == k]).sum(axis=0) >= LEAST_FRAMES).all()]
    if not keep:
        return None
    middle = np.stack([_trimmed(value[stretch == k]) for k in keep])
    left = np.concatenate([value[stretch == k] - m for k, m in zip(keep, middle, strict=True)])
    spread = 3.0 * 1.4826 * row_medians(np.abs(left).T) + 1e-9
    seen = np.sqrt(np.isfinite(left).sum(axis=0))
    left = np.clip(np.nan_to_num(left), -spread, spread)
    covariance = left.T @ left / (seen[:, None] * seen)
    covariance = (1.0 - SHRUNK) * covariance + SHRUNK * np.diag(np.diag(covariance))
    counted = np.array([np.isfinite(value[stretch == k]).sum(axis=0).mean() for k in keep]) / _together(left)
    at = np.array([s[stretch == k].mean() for k in keep])
    noise = covariance[None] / counted[:, None, None]
    leans = np.array([np.median(lean[stretch == k]) for k in keep])
    return FaceImage(at, middle, noise, place_mm, leans, np.array(keep) // stretches)


def _mean(value: Float) -> Float:
    """Means (f, p) of what is known of (f, p, w)."""
    known = np.isfinite(value)
    return np.asarray(np.where(known, value, 0.0).sum(axis=2) / np.where(known.any(axis=2), known.sum(axis=2), np.nan))


def _trimmed(value: Float) -> Float:
    """Means of (f, p) over the frames, values far beyond the others cut back."""
    middle = row_medians(value.T)
    reach = 3.0 * 1.4826 * row_medians(np.abs(value - middle).T) + 1e-9
    return np.asarray(np.nanmean(np.clip(value, middle - reach, middle + reach), axis=0))


def _together(left: Float) -> float:
    """How many neighbouring frames count as one, since they share what they leave (f, p): by their autocorrelation."""
    square = float((left**2).mean())
    total = 1.0
    for lag in range(1, min(30, len(left) // 4)):
        shared = float((left[lag:] * left[:-lag]).mean()) / max(square, 1e-30)
        if shared < 2.0 / math.sqrt(left.size):
            break
        total += 2.0 * shared
    return total


def forms(images: Sequence[FaceImage | None], at: Float, sensor: Linearity) -> tuple[FaceForm, ...]:
    """The form of each face at arc lengths `at` (m,) mm.

    A walk's strength, along the faces or over the sensor's columns, is one for all faces, as a sensor's is, so that
    each that a scan shows tells it, a wide one most; or each face's own: weighed by what the images say.
    """
    known = [None if one is None else _weighed(one, True) for one in images]
    nothing, out = np.zeros(at.size), []
    for f, (image, weighed, walk) in enumerate(zip(images, known, _walks(known), strict=True)):
        if image is None or weighed is None:
            out.append(FaceForm(nothing, nothing, nothing, 1.0, nothing, nothing, nothing))
            continue
        columns = [None if one is None else one.by_columns(image) for one in images]
        by_columns = _walks([None if one is None else _weighed(one, False) for one in columns])[f]
        out.append(_form(image, weighed.lasting(walk), at, sensor, float(by_columns @ WALKS**2)))
    return tuple(out)


def _walks(weighed: Sequence[_Weighed | None]) -> list[Float]:
    """Shares (w,) of the walk's strengths for each face: one for all, SENSOR times likelier before, or its own."""
    known = [None if one is None else np.logaddexp.reduce(one.log.sum(axis=0), axis=1) for one in weighed]
    logs = [one for one in known if one is not None]
    before = _log_prior(WALKS)
    together = np.sum(logs, axis=0) - (len(logs) - 1) * before if logs else before
    apart, one_for_all = sum(float(np.logaddexp.reduce(one)) for one in logs), float(np.logaddexp.reduce(together))
    share = 1.0 / (1.0 + math.exp(np.clip(apart - one_for_all, -50.0, 50.0)) / SENSOR)
    shared = share * np.exp(together - one_for_all)
    return [shared if one is None else shared + (1.0 - share) * np.exp(one - np.logaddexp.reduce(one)) for one in known]


class _Lasting(NamedTuple):
    """What lasts across the face in one stretch."""

    covariance: Float  # (p, p) of what may be anywhere, mm^2
    aside_mm: Float  # (p,) by which a part of the face stands aside
    aside_covariance: Float  # (p, p), mm^2


class _Weighed(NamedTuple):
    """Strengths of what lasts in k stretches, weighed by their likelihood."""

    image: FaceImage
    log: Float  # (k, walks, singles), parts that stand aside integrated out, with its share of the prior
    aside_mm: Float  # (k, walks, singles, p) by which such parts stand aside
    aside_square: Float  # (k, walks, singles, p, p) the mean products of that, mm^2

    def lasting(self, walk: Float) -> list[_Lasting]:
        """By shares (walks,) of the walk's strengths along the face."""
        found = []
        of_stretches = _walk(self.image), self.log, self.aside_mm, self.aside_square
        for shape, log, aside, square in zip(*of_stretches, strict=True):
            share = walk[:, None] * np.exp(log - np.logaddexp.reduce(log, axis=1)[:, None])
            covariance = float(walk @ WALKS**2) * shape
            covariance += float((share @ SINGLES**2).sum()) * np.eye(len(shape))
            mean, moment = np.tensordot(share, aside), np.tensordot(share, square)
            found.append(_Lasting(covariance, mean, moment - np.outer(mean, mean)))
        return found


def _weighed(image: FaceImage, with_parts: bool) -> _Weighed:
    """Restricted log-likelihoods of each stretch's mean residuals; with_parts: a part of the face may stand aside."""
    t = image.place_mm
    shapes = np.stack([np.ones_like(t), t / t[-1]], axis=1)
    base = image.noise[:, None, None] + FREE_MM**2 * shapes @ shapes.T + 1e-16 * np.eye(t.size)
    walk = _walk(image)[:, None, None]
    lasting = WALKS[:, None, None, None] ** 2 * walk + SINGLES[None, :, None, None] ** 2 * np.eye(t.size)
    factor = np.linalg.cholesky(base + lasting)
    white = np.linalg.solve(factor, np.broadcast_to(image.mean[:, None, None, :, None], (*factor.shape[:-1], 1)))
    prior = (_log_prior(WALKS)[:, None] + _log_prior(SINGLES)) / len(image.mean)  # once for all stretches
    log = prior - np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1) - 0.5 * (white[..., 0] ** 2).sum(axis=-1)
    found = _Weighed(image, log, np.zeros((*log.shape, t.size)), np.zeros((*log.shape, t.size, t.size)))
    if with_parts:
        _add_parts(found, factor, white)
    return found


def _add_parts(found: _Weighed, factor: Float, white: Float) -> None:
    """Let a part of the face stand aside as well, in place.

    factor (k, walks, singles, p, p): of the covariance, which makes the residuals white (k, walks, singles, p, 1).
    """
    ends, parts = _parts(factor.shape[-1])
    begin, end = parts.T
    least = found.log.max(axis=(1, 2), keepdims=True) - math.log(PART) - RARE
    cells = np.nonzero(found.log + 0.5 * (white[..., 0] ** 2).sum(axis=-1) > least)
    upto = np.linalg.solve(factor[cells], np.broadcast_to(ends.T, (len(cells[0]), *ends.T.shape)))
    products = np.swapaxes(upto, 1, 2) @ upto  # of all that lies above one end of a part and above another
    known = products[:, begin, begin] + products[:, end, end] - 2.0 * products[:, begin, end]
    told = (np.swapaxes(upto, 1, 2) @ white[cells])[..., 0]
    told = told[:, end] - told[:, begin]
    likely = found.log[cells] + 0.5 * (told**2 / known).max(axis=1) > np.broadcast_to(least, found.log.shape)[cells]
    cells = tuple(of[likely] for of in cells)
    known, told, square = known[likely, :, None], told[likely, :, None], ASIDE_MM**2
    variance = square / (1.0 + square * known)
    size = variance * told
    each = 0.5 * (size * told + np.log(variance / square)) + math.log(PART / (len(parts) * square.size))
    total = np.logaddexp(np.logaddexp.reduce(each, axis=(1, 2)), math.log1p(-PART))
    share = np.exp(each - total[:, None, None])
    shapes = ends[end] - ends[begin]
    moment = (share * (size**2 + variance)).sum(axis=2)
    found.log[cells] += total
    found.aside_mm[cells] = (share * size).sum(axis=2) @ shapes
    found.aside_square[cells] = (shapes.T * moment[:, None]) @ shapes


def _parts(places: int) -> tuple[Float, Int]:
    """Ends within a face (e, p), 1 on the places before each, and parts of up to half of it (b, 2) from end to end.

    An end may lie in the middle of a place.
    """
    at = np.arange(0.0, places + 0.5, 0.5)
    ends = np.clip(at[:, None] - np.arange(places), 0.0, 1.0)
    parts = np.stack(np.triu_indices(at.size, 1), axis=1)
    return ends, parts[np.diff(at[parts], axis=1)[:, 0] <= places / 2.0]


def _log_prior(strengths: Float) -> Float:
    some = np.minimum(1.0, USUAL_MM / np.maximum(strengths, 1e-9)) * (strengths > 0.0)
    return np.log(np.where(strengths == 0.0, NOTHING, (1.0 - NOTHING) * some / some.sum()))


def _walk(image: FaceImage) -> Float:
    """Covariances (k, p, p) across the face of a walk of the range of variance 1 a lateral mm, of means over places.

    From where the first of these begins: no level matters. Some may be missing.
    """
    wide = np.diff(image.place_mm).min()
    t = image.place_mm - image.place_mm[0] + wide / 2.0
    along = np.minimum.outer(t, t) - wide / 6.0 * np.eye(t.size)
    return np.asarray(along / image.lean[:, None, None] ** 3)


def _form(image: FaceImage, lasting: Sequence[_Lasting], at: Float, sensor: Linearity, walk: float) -> FaceForm:
    """What the line owes to what may last in each stretch.

    A line has the mean of what all passes at a place make of it, by what they tell of its direction: what lasts may be
    the face's own, and is held for the same in all; what the sensor errs by its columns (walk: of it, squared strength)
    averages, as far as passes see the face by other columns.
    """
    t = image.place_mm
    end = 0.5 * (3.0 * t[-1] - t[-2])
    line = np.linalg.pinv(np.stack([np.ones_like(t), t], axis=1))  # least squares: level and slope of places
    weights = np.stack([line[1], line[0] + end * line[1], line[0] - end * line[1]])
    # A part that stands aside at an end of the face is the face there, or not: as likely.
    beside = weights - 0.5 * np.stack([np.zeros_like(t), np.eye(t.size)[-1], np.eye(t.size)[0]])
    centred = weights @ (np.eye(t.size) - 1.0 / t.size)  # a sensor's or a face's common offset moves nothing
    rows = []
    for one, mean, noise in zip(lasting, image.mean, image.noise, strict=True):
        either = (beside - weights) @ one.aside_mm
        # returns of the face lie along another line than its own
        other = np.maximum((weights @ mean) ** 2 - _variance(weights, noise), 0.0)
        variance = _variance(centred, one.covariance) + _variance(beside, one.aside_covariance)
        rows.append(np.append(np.sqrt(variance + either**2 + other), beside @ one.aside_mm))
    passes = image.passes or (SeenBy(-math.inf, math.inf, t / image.lean[0], float(image.lean[0])),)
    tells = 1.0 / np.array([_variance(weights[:1], noise)[0] for noise in image.noise])
    share, told = np.zeros((len(passes), at.size)), np.zeros((len(passes), 6, at.size))
    for number, seen in enumerate(passes):
        mine = image.of_pass == number
        if mine.any():
            told[number] = [np.interp(at, image.s[mine], of) for of in np.array(rows)[mine].T]
            here = (at >= seen.first_mm) & (at <= seen.last_mm)
            share[number] = np.where(here, 1.0, 1e-6) * tells[mine].sum()  # where no pass is: all
    share /= share.sum(axis=0)
    apart = [[a.column_mm[:, None] - b.column_mm for b in passes] for a in passes]
    leans = np.array([one.lean for one in passes])
    both = np.multiply.outer(leans, leans)[..., None, None]
    field = sensor.covariance(np.array(apart)) - 0.5 * walk * _apart(np.array(apart), (t[1] - t[0]) / np.sqrt(both))
    field = np.einsum("cx,pqxy,cy->cpq", centred, field / both, centred)
    mean = np.einsum("pm,pcm->cm", share, told)
    by_sensor = np.einsum("pm,cpq,qm->cm", share, field, share)
    turn_u, lower_u, upper_u = np.sqrt(mean[:3] ** 2 + by_sensor)
    turn, lower, upper = mean[3:]
    aside_mm = max(float(np.abs(one.aside_mm).max()) for one in lasting)
    return FaceForm(turn_u, lower_u, upper_u, 2.0 * end, turn, lower, upper, aside_mm)


def _apart(middle_mm: Float, wide_mm: Float) -> Float:
    """Mean distance of two points of two places whose middles lie so far apart, each so wide."""
    away = np.minimum(np.abs(middle_mm) / wide_mm, 1.0)
    return np.abs(middle_mm) + wide_mm * (1.0 - away) ** 3 / 3.0


def _variance(weights: Float, covariance: Float) -> Float:
    """Of sums (w,) with weights (w, p)."""
    return np.asarray(np.einsum("wp,pq,wq->w", weights, covariance, weights))
