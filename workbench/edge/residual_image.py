"""What straight lines leave of a face in all frames together, and what that makes of its direction and its ends.

The residuals of a face are an image, frame by place on the face. What its noise does not explain, averaged over the
frames of a stretch of edge, lasts: a bow of the face, a pattern or the linearity of the sensor, a second return of a
part of it (ghost), a step. It is taken for a random walk along the face, errors of single places and a part that
stands aside as a whole; how strong they are is weighed by their restricted likelihood (Harville, JASA 72 (1977),
320), and what they make of the line follows (docs/method.md, 4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud
from workbench.edge.column_errors import ColumnErrors, Linearity
from workbench.edge.last_returns import SAMPLE_FRAMES
from workbench.geometry.along import by_pass
from workbench.geometry.blocks import as_input, evenly
from workbench.geometry.chains import FaceLines
from workbench.geometry.medians import median, row_medians
from workbench.kernels import kernel
from workbench.units import TO_SD, AnyArray, Bool, Float, Float32, Int, Shaped

LEAST_FRAMES, LEAST_PART = 4, 20  # of a stretch; of a part of one that is divided
APART_SD = 2.0  # standard deviations of single frames by which its parts differ
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
LEAST_NOISE_MM = 1e-6  # where all returns of a face lie on one digit, nothing else is left
# Shares, before, of faces of which a part stands aside as a whole, and of bowed ones; by how much, mm, alike likely.
PART, BOWED, OFFSETS_MM = 0.01, 0.01, np.array([0.01, 0.03, 0.1, 0.3])
RARE = 5.0  # a likelihood smaller by a factor whose logarithm is this counts for nothing
FIELD_STATIONS = 32  # of the edge, at which the sensor's errors are looked up


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
    part_offset_mm: float = 0.0  # by which a part of the face stands aside at most, as likely as it is
    bowed: Shaped[Float, " m"] | float = 0.0  # turn of its line by each mm of an end that is not seen, 1/mm

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
        return FaceForm(turn_u, lower_u, upper_u, self.width_mm, nothing, nothing, nothing, bowed=self.bowed)

    @property
    def offset_u_mm(self) -> Float:
        """Standard uncertainty (m,) of the face's place at one end or the other, mm."""
        return np.sqrt(0.5 * (self.lower_u_mm**2 + self.upper_u_mm**2))


class SeenBy(NamedTuple):
    """A pass that sees a face."""

    s: Shaped[Float, " k"]  # of some of its frames, in order, mm along the edge
    middle_mm: Shaped[Float, " k"]  # the face's middle in these, along the sensor's lateral axis
    column: Shaped[Float, " k"]  # and as a number of a column
    place_mm: Shaped[Float, " p"]  # of the places on the face beside that
    place: Shaped[Float, " p"]  # the same as numbers of columns
    lean: float  # mm along the face by mm of the sensor's lateral axis

    def seen_at(self, at: Float) -> tuple[Float, Float]:
        """What sees the places at arc lengths (m,): lateral places, mm, and columns, (m, p)."""
        middle, column = (np.interp(at, self.s, of)[:, None] for of in (self.middle_mm, self.column))
        return middle + self.place_mm, column + self.place


class FaceImage(NamedTuple):
    """The residual image of one face, averaged over the frames of each of k stretches of edge, pass by pass."""

    s: Shaped[Float, "k 2"]  # mm, from where on and up to where it holds; between these, what lies between
    mean: Shaped[Float, "k p"]  # across the face, mm
    noise: Shaped[Float, "k p p"]  # its covariance, mm^2
    place_mm: Shaped[Float, " p"]  # along the face from its middle, towards its lower end
    slope: Shaped[Float, " k"]  # of its line, in the sensor's axes, towards its lower end
    of_pass: Shaped[Int, " k"]  # number of the pass of each stretch
    passes: tuple[SeenBy, ...] = ()
    errors: ColumnErrors | None = None  # of the sensor where it sees the face; None: only what it is declared to err

    @property
    def lean(self) -> Float:
        """Millimetres (k,) along the face by one of the sensor's lateral axis."""
        return np.hypot(1.0, self.slope)


def face_image(
    cloud: Cloud,
    labels: AnyArray,
    face: FaceLines,
    label: int,
    side: Float,
    s_frames: Float,
    bow: Float | None = None,
    errors: ColumnErrors | None = None,
) -> FaceImage | None:
    """The residual image of the face with this label in `labels` (N, M); None: too little of it is seen.

    side (N,): its lower end lies towards rising side * x. s_frames (N,): arc length of each frame, mm.
    bow (N,): by which oblique frames see it bent along the range axis, times distance^2, 1/mm; None: by nothing.
    errors: what is open of those of the sensor's columns, which the cloud is rid of.
    """
    of_passes = by_pass(cloud.pass_index, np.isfinite(s_frames) & (face.count > LEAST_PLACES))
    frames = np.concatenate([np.zeros(0, np.int64), *(mine[evenly(mine.size, SAMPLE_FRAMES)] for mine in of_passes)])
    if frames.size < 2 * LEAST_FRAMES:
        return None
    slope = face.slope[frames]
    lean = face.lean[frames]
    on = (labels[frames] == label) & cloud.keep[frames]
    columns = np.flatnonzero(on.any(axis=0))
    part = slice(columns[0], columns[-1] + 1)
    on = on[:, part]
    half = np.sqrt(3.0) * float(np.median(np.sqrt(face.sxx[frames] / face.count[frames]) * lean))
    places = int(min(np.median(on.sum(axis=1)), PLACES))
    if places < LEAST_PLACES:
        return None
    spread = face.sxx[frames] / face.count[frames] * lean**2
    bent = np.zeros(frames.size) if bow is None else np.nan_to_num(bow[frames])
    line = np.stack([face.x_mean[frames], face.z_mean[frames], slope, side[frames], bent, spread], axis=1)
    x, z = (as_input(of[frames, part]) for of in (cloud.x_mm, cloud.z_mm))
    value = np.empty((frames.size, places))
    _laid_out(x, z, as_input(on), line, half, value)
    width = 2.0 * half / places
    place_mm, s = (np.arange(places) + 0.5 - 0.5 * places) * width, s_frames[frames]
    numbers, group = np.unique(cloud.pass_index[frames], return_inverse=True)
    image = _pooled(value, s, place_mm, slope * side[frames], group)
    if image is None:
        return None
    ends = face.columns[frames]
    first_mm, last_mm = np.take_along_axis(cloud.x_mm[frames], ends, axis=1).T
    pitch_mm = float(np.nanmedian((last_mm - first_mm) / np.maximum(ends[:, 1] - ends[:, 0], 1)))
    passes = []
    for number in range(numbers.size):
        mine = np.flatnonzero(group == number)
        mine = mine[np.argsort(s[mine])]
        of_pass = float(np.median(lean[mine]))
        lateral_mm = float(np.median(side[frames][mine])) * place_mm / of_pass
        middle_mm, column = face.x_mean[frames][mine], ends[mine].mean(axis=1)
        passes.append(SeenBy(s[mine], middle_mm, column, lateral_mm, lateral_mm / pitch_mm, of_pass))
    return image._replace(passes=tuple(passes), errors=errors)


@kernel
def _laid_out(x: Float32, z: Float32, on: Bool, line: Float, half: float, value: Float) -> None:
    """Fill in how far returns (f, n) of a face lie off its line, on average at places along it (f, p); else NaN.

    line (f, 6): x and z of its middle, its slope, the side of its lower end, the bow of an oblique frame (1/mm) and the
    mean square distance from the middle (mm^2), of which the line has its share; half (mm): of what is seen of it.
    """
    places = value.shape[1]
    total, count = np.empty(places), np.empty(places)
    for i in range(x.shape[0]):
        middle_x, middle_z, slope, side, bow, spread = line[i]
        lean = math.sqrt(1.0 + slope * slope)
        total[:] = 0.0
        count[:] = 0.0
        for j in range(x.shape[1]):
            if on[i, j]:
                dx = np.float64(x[i, j]) - middle_x
                k = math.floor((dx * side * lean / half + 1.0) * 0.5 * places)
                if 0 <= k < places:
                    bent = bow * ((dx * lean) ** 2 - spread)
                    total[k] += (np.float64(z[i, j]) - middle_z - slope * dx) / lean - bent
                    count[k] += 1.0
        for k in range(places):
            value[i, k] = total[k] / count[k] if count[k] > 0.0 else np.nan


def _pooled(value: Float, s: Float, place_mm: Float, slope: Float, group: Int) -> FaceImage | None:
    """The image of residuals (f, p) of frames at s (f,), mm, by stretches of each pass, group (f,) its number."""
    passes = int(group.max()) + 1
    stretches = max(1, min(math.floor(np.ptp(s) / STRETCH_MM), len(value) // (STRETCH_FRAMES * passes)))
    stretch = np.minimum((s - s.min()) / max(float(np.ptp(s)), 1e-9) * stretches, stretches - 1).astype(np.int64)
    stretch += group * stretches
    of, holds = [], []
    for k in range(stretches * passes):
        mine = np.flatnonzero(stretch == k)
        if mine.size < LEAST_FRAMES:
            continue
        parts = _alike(value, mine[np.argsort(s[mine])])
        of += parts
        holds += [[s[one].min(), s[one].max()] if len(parts) > 1 else 2 * [s[one].mean()] for one in parts]
    return _image(value, of, np.array(holds), place_mm, slope, np.array([group[one[0]] for one in of], np.int64))


def _image(
    value: Float, of: Sequence[Int], holds: Float, place_mm: Float, slope: Float, numbers: Int
) -> FaceImage | None:
    """The image of residuals (f, p), averaged over the frames `of` each of k stretches; holds (k, 2), mm."""
    known = np.isfinite(value)
    count = [known[mine].sum(axis=0) for mine in of]
    keep = [k for k, one in enumerate(count) if one.min() >= LEAST_FRAMES]
    if not keep:
        return None
    middle = np.stack([_trimmed(value[of[k]]) for k in keep])
    left = np.concatenate([value[of[k]] - m for k, m in zip(keep, middle, strict=True)])
    spread = 3.0 * TO_SD * row_medians(np.abs(left).T) + 1e-9
    seen = np.sqrt(sum(count[k] for k in keep))
    left = np.where(np.isnan(left), 0.0, left).clip(-spread, spread)
    covariance = left.T @ left / (seen[:, None] * seen)
    covariance = (1.0 - SHRUNK) * covariance + SHRUNK * np.diag(np.diag(covariance))
    counted = np.array([count[k].mean() for k in keep]) / _together(left)
    noise = covariance[None] / counted[:, None, None]
    slopes = np.array([median(slope[of[k]]) for k in keep])
    return FaceImage(holds[keep], middle, noise, place_mm, slopes, numbers[keep])


def _between(at: Float, holds: Float, rows: Float) -> Float:
    """Rows (k, c) at places (m,): each where it holds, (k, 2) mm, else between its neighbours (c, m)."""
    return np.stack([np.interp(at, holds.ravel(), np.repeat(one, 2)) for one in rows.T])


def _alike(value: Float, frames: Int) -> list[Int]:
    """Frames of a stretch, parted where what they leave (f, p) changes by more than frames of one side differ by.

    So it does where second returns of a face begin, or a step of it: the mean of all is that of neither side.
    """
    cut = np.arange(LEAST_PART, frames.size - LEAST_PART + 1)
    if not cut.size:
        return [frames]
    left = np.nan_to_num(value[frames] - row_medians(value[frames].T))
    total, square = np.cumsum(left, axis=0), np.cumsum(left**2, axis=0)[-1]
    before, after = total[cut - 1] / cut[:, None], (total[-1] - total[cut - 1]) / (frames.size - cut)[:, None]
    within = square - cut[:, None] * before**2 - (frames.size - cut)[:, None] * after**2
    apart = ((after - before) ** 2 / (within / frames.size + LEAST_NOISE_MM**2)).mean(axis=1)
    at = int(apart.argmax())
    if apart[at] < APART_SD**2:
        return [frames]
    return [*_alike(value, frames[: cut[at]]), *_alike(value, frames[cut[at] :])]


def _trimmed(value: Float) -> Float:
    """Means of (f, p) over the frames, values far beyond the others cut back."""
    middle = row_medians(value.T)
    reach = 3.0 * TO_SD * row_medians(np.abs(value - middle).T) + 1e-9
    cut = value.clip(middle - reach, middle + reach)
    known = np.isfinite(cut)
    return np.asarray(np.where(known, cut, 0.0).sum(axis=0) / known.sum(axis=0))


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

    A walk's strength along the faces is one for all, as a sensor's is, so that each that a scan shows tells it, a wide
    one most; or each face's own: weighed by what the images say.
    """
    known = [None if one is None else _weighed(one) for one in images]
    nothing, out = np.zeros(at.size), []
    for image, weighed, walk in zip(images, known, _walks(known), strict=True):
        if image is None or weighed is None:
            out.append(FaceForm(nothing, nothing, nothing, 1.0, nothing, nothing, nothing))
            continue
        out.append(_form(image, weighed.lasting(walk), at, sensor))
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
    part_offset_mm: Float  # (p,) by which a part of the face stands aside
    part_covariance: Float  # (p, p), mm^2


class _Weighed(NamedTuple):
    """Strengths of what lasts in k stretches, weighed by their likelihood."""

    image: FaceImage
    log: Float  # (k, walks, singles), parts that stand aside integrated out, with its share of the prior
    part_offset_mm: Float  # (k, walks, singles, p) by which such parts stand aside
    part_square: Float  # (k, walks, singles, p, p) the mean products of that, mm^2

    def lasting(self, walk: Float) -> list[_Lasting]:
        """By shares (walks,) of the walk's strengths along the face."""
        found = []
        of_stretches = _walk(self.image), self.log, self.part_offset_mm, self.part_square
        for shape, log, offset, square in zip(*of_stretches, strict=True):
            share = walk[:, None] * np.exp(log - np.logaddexp.reduce(log, axis=1)[:, None])
            covariance = float(walk @ WALKS**2) * shape
            covariance += float((share @ SINGLES**2).sum()) * np.eye(len(shape))
            mean, moment = np.tensordot(share, offset), np.tensordot(share, square)
            found.append(_Lasting(covariance, mean, moment - np.outer(mean, mean)))
        return found


def _weighed(image: FaceImage) -> _Weighed:
    """Restricted log-likelihoods of each stretch's mean residuals."""
    t = image.place_mm
    shapes = np.stack([np.ones_like(t), t / t[-1]], axis=1)
    base = image.noise + FREE_MM**2 * shapes @ shapes.T + LEAST_NOISE_MM**2 * np.eye(t.size)
    means = _Means(*map(as_input, (image.mean, base, _walk(image), WALKS**2, SINGLES**2)))
    prior = (_log_prior(WALKS)[:, None] + _log_prior(SINGLES)) / len(image.mean)  # once for all stretches
    log, square = np.empty((2, len(image.mean), *prior.shape))
    _likelihoods(means, log, square)
    log += prior
    found = _Weighed(image, log, np.zeros((*log.shape, t.size)), np.zeros((*log.shape, t.size, t.size)))
    least = log.max(axis=(1, 2)) - math.log(PART) - RARE
    possible = np.argwhere(log + 0.5 * square > least[:, None, None])
    _add_parts(means, possible, least, *_parts(t.size), log, found.part_offset_mm, found.part_square)
    return found


class _Means(NamedTuple):
    """What k stretches leave on average on p places, and what its covariance may be: base + w walk + s."""

    mean: Shaped[Float, "k p"]
    base: Shaped[Float, "k p p"]
    walk: Shaped[Float, "k p p"]
    walks: Float  # (walks,) of w
    singles: Float  # (singles,) of s


@kernel
def _whitened(means: _Means, k: int, w: int, n: int, lower: Float, white: Float) -> float:
    """Fill in the Cholesky factor (p, p) of a covariance, 1 / its diagonal on it, and the white mean (p,).

    Returns the logarithm of its determinant's inverse root.
    """
    root = 1.0
    for i in range(white.size):
        rest = means.mean[k, i]
        for j in range(i + 1):
            total = means.base[k, i, j] + means.walks[w] * means.walk[k, i, j]
            for m in range(j):
                total -= lower[i, m] * lower[j, m]
            if j < i:
                lower[i, j] = total * lower[j, j]
                rest -= lower[i, j] * white[j]
            else:
                lower[i, i] = 1.0 / math.sqrt(total + means.singles[n])
        white[i] = rest * lower[i, i]
        root *= lower[i, i]
    return math.log(root)


@kernel
def _likelihoods(means: _Means, log: Float, square: Float) -> None:
    """Fill in log-likelihoods (k, walks, singles), and the squares of the white means."""
    places = means.mean.shape[1]
    lower, white = np.zeros((places, places)), np.empty(places)
    for k in range(log.shape[0]):
        for w in range(log.shape[1]):
            for n in range(log.shape[2]):
                root, total = _whitened(means, k, w, n, lower, white), 0.0
                for one in white:
                    total += one * one
                log[k, w, n], square[k, w, n] = root - 0.5 * total, total


@kernel
def _add_parts(
    means: _Means, cells: Int, least: Float, ends: Float, parts: Int, log: Float, offset: Float, square: Float
) -> None:
    """Let a part of the face stand aside as well, in `cells` (c, 3) of k, walks and singles, in place.

    Where that is no likelier than `least` (k,), nothing changes. ends (e, p), parts (b, 2): of `_parts`.
    """
    count, places = ends.shape
    lower, white, upto = np.zeros((places, places)), np.empty(places), np.empty((count, places))
    known, force, share = np.empty(len(parts)), np.empty(len(parts)), np.empty((len(parts), OFFSETS_MM.size))
    each, bowed = math.log(PART / share[:-1].size), BOWED / PART * (len(parts) - 1)
    for k, w, n in cells:
        _whitened(means, k, w, n, lower, white)
        for e in range(count):  # what makes the residuals white, of all that lies above an end
            for i in range(places):
                rest = ends[e, i]
                for m in range(i):
                    rest -= lower[i, m] * upto[e, m]
                upto[e, i] = rest * lower[i, i]
        likely = _forces_of_parts(upto, white, parts, known, force)
        if log[k, w, n] + likely > least[k]:
            none = math.exp(math.log1p(-PART - BOWED) - each - likely)
            log[k, w, n] += each + likely + math.log(_shares_of_parts(known, force, likely, none, bowed, share))
            _moments_of_parts(known, force, share, ends, parts, offset[k, w, n], square[k, w, n])


@kernel
def _forces_of_parts(upto: Float, white: Float, parts: Int, known: Float, force: Float) -> float:
    """Fill in 1 / variance and force, size over variance, of parts (b, 2); the largest log-likelihood that one adds."""
    likely = 0.0
    for b in range(len(parts)):
        begin, end = parts[b]
        known[b] = force[b] = 0.0
        for i in range(white.size):
            of = upto[end, i] - upto[begin, i]
            known[b] += of * of
            force[b] += of * white[i]
        likely = max(likely, 0.5 * force[b] ** 2 / known[b])
    return likely


@kernel
def _shares_of_parts(known: Float, force: Float, likely: float, none: float, bowed: float, share: Float) -> float:
    """Fill in the shares (b, sizes) of parts that stand aside by each of OFFSETS_MM; the sum before, with `none`.

    bowed: how much likelier than such a part a bow is, the last of them.
    """
    total = none
    for b in range(known.size):
        prior = bowed if b == known.size - 1 else 1.0
        for m in range(OFFSETS_MM.size):
            free = 1.0 / (1.0 + OFFSETS_MM[m] ** 2 * known[b])
            share[b, m] = prior * math.sqrt(free) * math.exp(0.5 * free * (OFFSETS_MM[m] * force[b]) ** 2 - likely)
            total += share[b, m]
    for b in range(known.size):
        for m in range(OFFSETS_MM.size):
            share[b, m] /= total
    return total


@kernel
def _moments_of_parts(
    known: Float, force: Float, share: Float, ends: Float, parts: Int, offset: Float, square: Float
) -> None:
    """Fill in by how much places (p,) stand aside on average, and the mean products (p, p), by shares (b, sizes).

    A bowed face stands aside nowhere: its line is that of least squares.
    """
    (count, places), of_ends = ends.shape, np.zeros(len(ends))
    of_both, half = np.zeros((count, count)), np.zeros((count, places))
    for b in range(known.size - 1):
        begin, end = parts[b]
        mean, moment = 0.0, 0.0
        for m in range(OFFSETS_MM.size):
            variance = OFFSETS_MM[m] ** 2 / (1.0 + OFFSETS_MM[m] ** 2 * known[b])
            size = variance * force[b]
            mean += share[b, m] * size
            moment += share[b, m] * (size * size + variance)
        for e, sign in ((end, 1.0), (begin, -1.0)):
            of_ends[e] += sign * mean
            of_both[e, e] += moment
            of_both[e, begin + end - e] -= moment
    for e in range(count):
        for i in range(places):
            offset[i] += of_ends[e] * ends[e, i]
            for f in range(count):
                half[f, i] += of_both[f, e] * ends[e, i]
    for e in range(count):
        for i in range(places):
            for j in range(places):
                square[i, j] += ends[e, i] * half[e, j]


def _parts(places: int) -> tuple[Float, Int]:
    """Ends within a face (e, p), 1 on the places before each, and parts of up to half of it (b, 2) from end to end.

    An end may lie in the middle of a place. The last is no end but a bow, and the whole face has it.
    """
    at = np.arange(0.0, places + 0.5, 0.5)
    ends = np.clip(at[:, None] - np.arange(places), 0.0, 1.0)
    parts = np.stack(np.triu_indices(at.size, 1), axis=1)
    parts = parts[np.diff(at[parts], axis=1)[:, 0] <= places / 2.0]
    bow = np.linspace(-1.0, 1.0, places) ** 2
    return np.vstack([ends, bow]), np.vstack([parts, [0, len(ends)]])


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


def _form(image: FaceImage, lasting: Sequence[_Lasting], at: Float, sensor: Linearity) -> FaceForm:
    """What the line owes to what may last in each stretch.

    A line has the mean of what all passes at a place make of it, by what they tell of its direction: what lasts may be
    the face's own, and is held for the same in all; what the sensor errs by its columns averages, as far as passes see
    the face by other columns.
    """
    t = image.place_mm
    end = 0.5 * (3.0 * t[-1] - t[-2])
    line = np.linalg.pinv(np.stack([np.ones_like(t), t], axis=1))  # least squares: level and slope of places
    weights = np.stack([line[1], line[0] + end * line[1], line[0] - end * line[1]])
    # A part that stands aside at an end of the face is the face there, or not: as likely.
    mixed_weights = weights - 0.5 * np.stack([np.zeros_like(t), np.eye(t.size)[-1], np.eye(t.size)[0]])
    bend = np.linalg.pinv(t[:, None] ** np.arange(3.0))[2:]
    centred = weights @ (np.eye(t.size) - 1.0 / t.size)  # a sensor's or a face's common offset moves nothing
    rows = []
    for one, mean, noise, slope in zip(lasting, image.mean, image.noise, image.slope, strict=True):
        ambiguity = (mixed_weights - weights) @ one.part_offset_mm
        # returns of the face lie along another line than its own
        other = np.maximum((weights @ mean) ** 2 - _variance(weights, noise), 0.0)
        variance = _variance(centred, one.covariance) + _variance(mixed_weights, one.part_covariance)
        turn, lower, upper = mixed_weights @ one.part_offset_mm
        # Returns stand aside along the rays: across the line as it lies, by less than across the face.
        straight = slope - (1.0 + slope**2) * turn
        flatter = math.sqrt((1.0 + slope**2) / (1.0 + straight**2))
        moved = math.atan(slope) - math.atan(straight), flatter * lower, flatter * upper
        bowed = float(np.maximum((bend @ mean) ** 2 - _variance(bend, noise), 0.0)[0]) ** 0.5
        across = np.array([flatter**2, flatter, flatter])
        rows.append([*(across * np.sqrt(variance + ambiguity**2 + other)), *moved, flatter**2 * bowed])
    tells = 1.0 / np.array([_variance(weights[:1], noise)[0] + LEAST_NOISE_MM**2 for noise in image.noise])
    share, terms = np.zeros((len(image.passes), at.size)), np.zeros((len(image.passes), 7, at.size))
    for number, seen in enumerate(image.passes):
        mine = image.of_pass == number
        if mine.any():
            terms[number] = _between(at, image.s[mine], np.array(rows)[mine])
            shows = (at >= seen.s[0]) & (at <= seen.s[-1])
            share[number] = np.where(shows, 1.0, 1e-6) * tells[mine].sum()  # where no pass is: all
    share /= share.sum(axis=0)
    some = evenly(at.size, FIELD_STATIONS)
    by_sensor = np.zeros((3, some.size))
    for a, here in enumerate(image.passes):
        for b, other in enumerate(image.passes):
            (x, columns), (y, other_columns) = here.seen_at(at[some]), other.seen_at(at[some])
            errs = sensor.covariance(x[:, :, None] - y[:, None, :])
            if image.errors is not None:
                errs = errs + image.errors.common(columns, other_columns)
            errs = np.einsum("cx,kxy,cy->ck", centred, errs, centred) / (here.lean * other.lean)
            by_sensor += share[a, some] * errs * share[b, some]
    mean = np.einsum("pm,pcm->cm", share, terms)
    variance = np.stack([np.interp(at, at[some], row) for row in by_sensor])
    turn_u, lower_u, upper_u = np.sqrt(mean[:3] ** 2 + np.maximum(variance, 0.0))
    turn, lower, upper, bowed = mean[3:]
    part_offset_mm = max(float(np.abs(one.part_offset_mm).max()) for one in lasting)
    return FaceForm(turn_u, lower_u, upper_u, 2.0 * end, turn, lower, upper, part_offset_mm, bowed)


def _variance(weights: Float, covariance: Float) -> Float:
    """Of sums (w,) with weights (w, p)."""
    return np.asarray(np.einsum("wp,pq,wq->w", weights, covariance, weights))
