"""Both plates of a groove in the section planes of its course: lines of their faces, and where their returns end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.ndimage

from workbench.artefacts import Cloud
from workbench.edge.column_errors import Linearity, notes_of, without_column_errors
from workbench.edge.directions import wrapped
from workbench.edge.fillet import Fillets, fit_below_flank, fit_circle
from workbench.edge.groove_frames import LEAST_FACE, ReadFrames, middles, read_frames
from workbench.edge.groove_profile import DROP_MM, DROP_POINTS, SHARED, Kind, Side
from workbench.edge.joint_lines import FaceLine, joined, meeting, typical
from workbench.edge.layers import Surface, surface, without_layers
from workbench.edge.residual_image import FaceImage, face_image
from workbench.edge.unseen import cut_by_dark
from workbench.errors import InputError
from workbench.geometry.chains import FaceLines, labelled_lines
from workbench.geometry.course import Course, fit_course
from workbench.geometry.curves import Curve
from workbench.geometry.fading import faded_columns
from workbench.geometry.grids import columns_to_next
from workbench.geometry.sections import SectionLines, in_section, on_line, section_lines
from workbench.units import DEG, AnyArray, Bool, Float, Int, Shaped

LABELS = ((1, 2), (3, 4))  # upper surface and the face below it, of the left and of the right plate
UNSEEN = ("edge", "hidden")  # kinds of plates of whose faces nothing, or a fillet only, is seen
SHOWS = 0.5  # share of the profiles that show a root face, for it to be measured
COVERED = 0.34  # of profiles in which something joins a plate's end, from which on nothing tells where it is
ADJOINS_COLUMNS, ADJOINS_RETURNS = 2, 3  # at most between the plates' ends, where these lie side by side in the view
MOST_BETWEEN = DROP_POINTS + SHARED + 1  # as few do not tell a weld; they join the ends where none lies deeper
LAST_COLUMNS = 20  # of a face, among which those without return are counted
NEARER_MM, NEARER_RETURNS = 0.5, 3  # what hides an end: so much above the last return, so many returns of it in a row
THIRD = 3  # return beyond an upper surface's end
NEAR_RETURNS = 30  # of an upper surface, that tell how far apart its returns lie
NEIGHBOURS = 9  # frames, of which the middle one tells how far an edge is rounded
RADIUS_MM = 4.0  # of a fillet, before one is known


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """One plate of n profiles in the section planes, drawn as a left one: the right plate's a is mirrored."""

    kind: Kind
    lines: tuple[FaceLine, ...]  # the upper surface and, but of an `UNSEEN` kind, the face below it
    images: tuple[FaceImage | None, ...]  # what these leave of their returns
    sigma: float  # noise of a return across the face, mm
    end: Shaped[Float, "n 2"]  # innermost return of the upper surface
    last: Shaped[Float, "n 2"]  # innermost return of the plate; NaN where something covers its end
    step: Shaped[Float, " n"]  # from there to the next column
    edge_step: Shaped[Float, " n"]  # from the upper surface's last return to the next column
    missing: float  # mm of the upper surface, as many columns return nothing beyond the last return, before others do
    # how far above the plate's last return the other plate's lies that is next to it in the profile; NaN where columns
    # without return, or more than a few returns, lie between them, or where a root face is seen below
    next_up: Shaped[Float, " n"]
    grazing: Shaped[Float, " n"]  # how many times as far apart as on the plate the returns stand on the face
    rounded: Shaped[Float, " n"]  # mm of a rounded edge seen beyond the upper surface, where nothing is seen below it
    radius_lever: Shaped[Float, " n"]  # of the fillet's radius, a mm of its form: large where a short arc is seen
    fillets: Fillets
    lowest: Shaped[Float, "n 2"]  # lowest return of the root face; NaN: none, or something covers its end
    root_a: Shaped[Float, " n"]  # a of the root face's returns; NaN where it is not seen
    spacing: Shaped[Float, " n"]  # of its returns, down
    lost: Shaped[Float, "n 2"]  # share of the last columns without return, of the face and of the root face
    fade: Shaped[Float, " n"]  # columns over which returns become rare towards the last one
    below: Shaped[Float, "n 2"]  # from the last return of the bevel to that of the root face, inwards and down; NaN
    outwards: Shaped[Int, " n"]  # column of the innermost return, below 0 where the groove lies towards column 0
    cut: Shaped[Bool, " n"]  # whether a dark column, or what is nearer, ends what is seen: `end` or `last`, NaN then
    parted_mm: float  # `Side.parted_mm` of most profiles; NaN: fewer than a third show something there

    @property
    def is_covered(self) -> bool:
        """Whether something joins the last return: a weld, a backing strip, a land."""
        return math.isfinite(self.parted_mm)

    def corner(self, places: Sequence[Float], angles: Sequence[Float], beyond_mm: Float | float = 0.0) -> Float:
        """Upper corners (n, 2) by its lines; where nothing is seen below, half a column beyond the last return."""
        if len(places) > 1:
            return meeting(places[0], angles[0], places[1], angles[1])
        along = np.stack([np.cos(angles[0]), np.sin(angles[0])], axis=1)
        end = ((self.end - places[0]) * along).sum(axis=1) + 0.5 * self.edge_step + beyond_mm
        return on_line(places[0], angles[0], end)

    @property
    def shows_root_face(self) -> bool:
        """Whether most profiles do."""
        return bool(np.isfinite(self.root_a).mean() > SHOWS)

    def reach(self, corner: Float, angle: Float) -> Float:
        """How far the face below reaches from the corners (n, 2) in direction `angle` (n,); above a fillet: inwards."""
        if self.kind != "bevel":
            return np.asarray(self.last[:, 0] - corner[:, 0])
        if self.shows_root_face:  # where it meets that
            return np.asarray((self.root_a - corner[:, 0]) / np.cos(angle))
        return np.asarray(
            (self.last[:, 0] - corner[:, 0]) * np.cos(angle) + (self.last[:, 1] - corner[:, 1]) * np.sin(angle)
        )

    def root(self, corner: Float, angle: Float, reach: Float, lift_mm: Float | float) -> Float:
        """Upper edges (n, 2) of the root, where the face reaches so far; of a fillet that lies so much higher."""
        if self.kind == "bevel":
            return on_line(corner, angle, reach)
        return np.stack([corner[:, 0] + reach, self.fillets.bottom + lift_mm], axis=1)

    @property
    def fall(self) -> Float:
        """Angle (n,) of the face below the upper surface, rad."""
        return self.lines[0].angle - self.lines[1].angle

    @property
    def lean_deg(self) -> float:
        """By how much what is taken for the root face leans from the square to its plate; 0: none is seen.

        By the bevel's last return and the lowest one, less a column.
        """
        shown = np.isfinite(self.below[:, 0])
        if not shown.mean() > LEAST_FACE:
            return 0.0
        inwards, down = np.median(self.below[shown], axis=0)
        beyond = max(float(inwards - np.nanmedian(self.step)), 0.0)
        return math.atan2(beyond, float(down)) / DEG


def plates(
    cloud: Cloud, labels: AnyArray, read: ReadFrames, curve: Curve, s: Float, sensor: Linearity
) -> tuple[tuple[Plate, Plate], Course, float, tuple[str, ...]]:
    """Both plates of the profiles at s (n,) of a cloud, drawn as left ones.

    Also the direction of their upper surfaces in the curve's frame, a course of its difference from a constant; and
    what was taken off the ranges, in words.
    """
    points, _ = middles(cloud, read)
    _, middle = in_section(points, curve, s)
    mine = cloud.of_frames(read.frame)
    shown = [pair[: 1 if kind in UNSEEN else 2] for kind, pair in zip(read.kinds, LABELS, strict=True)]

    def lines(of: Cloud) -> dict[int, FaceLines]:
        """Of all faces that are shown."""
        return {label: labelled_lines(of.x_mm, of.z_mm, labels, label) for pair in shown for label in pair}

    mine, errors = without_column_errors(mine, labels, lines(mine), sensor)
    by_label = lines(mine)
    faces = [[by_label[label] for label in pair] for pair in shown]
    ways = [-read.flip, read.flip]  # towards the groove
    sections = [
        [section_lines(one, one.slope, mine.base_from_profiler, way, _noise(one), curve, s) for one in pair]
        for pair, way in zip(faces, ways, strict=True)
    ]
    both = np.exp(1j * sections[0][0].angle) - np.exp(1j * sections[1][0].angle)
    about = float(np.angle(np.nanmean(both)))
    tilt = fit_course(s, wrapped(about - np.angle(both)), None, mine.pass_index)
    turn, out = about - tilt.value(s), []
    for k in (0, 1):
        images = [
            face_image(mine, labels, one, label, ways[k], s, errors=errors.get(label))
            for one, label in zip(faces[k], shown[k], strict=True)
        ]
        out.append(_plate(_View(mine, read, curve, s, turn, middle, k), sections[k], images))
    return (out[0], out[1]), tilt, about, notes_of(errors)


def labels_of(cloud: Cloud, read: ReadFrames) -> AnyArray:
    """The returns (n, M) of a cloud of the profiles that were read, by their faces."""
    labels = np.zeros(cloud.keep.shape, np.uint8)
    for sides, (upper, face) in zip(read.sides, LABELS, strict=True):
        for k, (side, columns) in enumerate(zip(sides, read.columns, strict=True)):
            labels[k, columns[side.upper]], labels[k, columns[side.face]] = upper, face
    return labels


def bare(cloud: Cloud, read: ReadFrames) -> tuple[Cloud, ReadFrames, tuple[str, ...]]:
    """A groove's cloud without layers that end beside an upper edge, read; and what they were, in words."""
    named = {
        f"{name} plate": [_upper_surface(cloud, read, which, k) for k in range(len(read.frame))]
        for which, name in enumerate(("left", "right"))
    }
    lowered, notes = without_layers(cloud, read.frame, named, read.up)
    return lowered, read_frames(lowered) if notes else read, notes


def _upper_surface(cloud: Cloud, read: ReadFrames, which: int, k: int) -> Surface:
    """Of a plate in the k-th profile that was read, up to the face below it."""
    side, columns, step = read.sides[which][k], read.columns[k], (1, -1)[which]
    below, upper = (side.face if side.face.size else side.arc)[::step], side.upper[::step]
    inner = int(below[0]) - step if below.size else side.end
    x, z = (of[read.frame[k], columns].astype(np.float64) for of in (cloud.x_mm, cloud.z_mm))
    return surface(x, z, read.up, columns, upper, inner, int(upper[0]))


def _noise(face: FaceLines) -> Float:
    return np.full(face.count.size, face.noise_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """The profiles of a groove, one plate of which is drawn as a left one."""

    cloud: Cloud  # of these profiles alone
    read: ReadFrames
    curve: Curve
    s: Shaped[Float, " n"]
    turn: Shaped[Float, " n"]  # direction from the left to the right plate in the curve's frame
    middle: Shaped[Float, "n 2"]  # between both upper edges, beside the curve
    which: int

    @property
    def sides(self) -> list[Side]:
        """What every profile was read as."""
        return self.read.sides[self.which]

    @property
    def wander(self) -> Float:
        """By how much both plates lie beside the curve (n, 2): the robot's errors."""
        return self._rotated(self.middle, self.turn)

    def points(self, places: Sequence[Int]) -> list[Float]:
        """Of each profile's points with these indices (k,), in its section planes: (k, 2)."""
        frame = np.repeat(np.arange(len(places)), [one.size for one in places])
        column = np.concatenate([of[one] for of, one in zip(self.read.columns, places, strict=True)])
        _, place = in_section(self.cloud.placed(frame, column), self.curve, self.s[frame])
        return np.split(self._rotated(place, self.turn[frame]), np.cumsum([one.size for one in places])[:-1])

    def _rotated(self, place: Float, turn: Float) -> Float:
        c, d, mirror = np.cos(turn), np.sin(turn), (1.0, -1.0)[self.which]
        return np.stack([mirror * (place[:, 0] * c + place[:, 1] * d), place[:, 0] * d - place[:, 1] * c], axis=1)

    def drawn(self, line: SectionLines, is_face: bool) -> SectionLines:
        """A face's lines; those of a `face` fall, even past the vertical."""
        angle = wrapped(self.turn - line.angle if self.which == 0 else math.pi - self.turn + line.angle)
        back = (angle > 0.0) & is_face
        return replace(
            line,
            place=self._rotated(line.place, self.turn),
            angle=np.where(back, angle - math.pi, angle),
            run=np.where(back, -line.run, line.run),
            ray=self._rotated(line.ray, self.turn),
        )


def _plate(view: _View, sections: Sequence[SectionLines], images: Sequence[FaceImage | None]) -> Plate:
    sides, columns, z_mm = view.sides, view.read.columns, view.cloud.z_mm
    n, kind = len(sides), view.read.kinds[view.which]
    lines = [view.drawn(one, k > 0) for k, one in enumerate(sections)]
    sigma = typical(np.sqrt(lines[-1].offset_variance * [one.face.size or one.upper.size for one in sides]), 0.02)
    ends = view.points([np.array([side.end, side.last]) for side in sides])
    end, last = np.array([one[0] for one in ends]), np.array([one[1] for one in ends])
    outwards = [_outwards(view, [getattr(side, name) for side in sides]) for name in ("end", "last")]
    beyond_end, beyond_last = (columns_to_next(z_mm, one) for one in outwards)
    near = slice(-NEAR_RETURNS, None) if view.which == 0 else slice(NEAR_RETURNS)
    upper = view.points([side.upper[near] for side in sides])
    pitch = np.array([float(np.median(np.hypot(*np.diff(one, axis=0).T))) for one in upper])
    lowest, beneath, root_a, spacing = (np.full(shape, np.nan) for shape in ((n, 2), (n, 2), n, n))
    for k, below in enumerate(view.points([side.below for side in sides])):
        if len(below) >= 2:
            lowest[k] = below[np.argmin(below[:, 1])]
            beneath[k] = np.abs(lowest[k] - last[k])
            root_a[k], spacing[k] = float(np.median(below[:, 0])), float(np.median(np.abs(np.diff(below[:, 1])))) + 1e-3
    parted = np.array([side.parted_mm for side in sides])
    covered = np.isfinite(parted)
    parted_mm = typical(parted) if covered.mean() > COVERED else math.nan
    last[(covered & np.isnan(root_a)) | math.isfinite(parted_mm)] = np.nan
    lowest[covered | math.isfinite(parted_mm)] = np.nan
    hangs, cut = end.copy() if len(lines) == 1 else None, _hidden_by_nearer(view)
    last[cut] = np.nan
    for place, column in ((last, outwards[1]), (end, outwards[0]))[: 2 if kind in UNSEEN else 1]:
        mine = cut_by_dark(view.cloud, column, (place - view.wander)[:, 0], pitch)
        place[mine], cut = np.nan, cut | mine
    lever, fillets = np.full(n, np.nan), Fillets(n)
    if kind == "hidden":
        lever = _hidden_fillets(view, lines[0], fillets)
    if kind == "round":
        lines[1] = _below_flanks(view, lines[1], fillets)
    steps = np.array([side.step_mm for side in sides], dtype=np.float64)
    edge_step = np.asarray(pitch * beyond_end, dtype=np.float64)
    if kind in UNSEEN and np.mean(beyond_end == 1) > COVERED:  # beside blind columns, or a gap that looks like these
        edge_step[beyond_end > 1] = np.nan
    return Plate(
        kind,
        tuple(joined(lines, view.s, view.cloud.pass_index, view.wander, hangs)),
        tuple(images),
        sigma,
        end,
        last,
        np.asarray(steps * beyond_last, dtype=np.float64),
        edge_step,
        float(np.median(pitch * [_without_return(*one, view.which) for one in zip(columns, sides, strict=True)])),
        _next_up(view),
        steps / pitch,
        scipy.ndimage.median_filter(np.array([side.rounded_mm for side in sides]), NEIGHBOURS, mode="nearest"),
        lever,
        fillets,
        lowest,
        root_a,
        spacing,
        np.array(
            [
                [_lost(of[on], of[side.last]) for on in (side.arc if side.arc.size else side.face, side.below)]
                for of, side in zip(columns, sides, strict=True)
            ]
        ),
        faded_columns(z_mm, outwards[1], np.isfinite(last[:, 0]), view.cloud.pass_index),
        beneath,
        outwards[1],
        cut,
        parted_mm,
    )


def _hidden_fillets(view: _View, plate: SectionLines, fillets: Fillets) -> Float:
    """By how much an error across the arc of each profile moves its radius (n,); NaN: no circle, else it is added."""
    out, noise = np.full(view.s.size, np.nan), typical(np.sqrt(plate.offset_variance), 0.02)
    for k, (arc, side) in enumerate(zip(view.points([one.arc for one in view.sides]), view.sides, strict=True)):
        ray = plate.ray[k] / np.linalg.norm(plate.ray[k])
        circle = fit_circle(arc, ray, noise * math.sqrt(side.upper.size)) if len(arc) else None
        if circle is not None:
            fillets.add(k, circle)
            half = math.asin(min(1.0, 0.5 * float(np.linalg.norm(arc[-1] - arc[0])) / circle.radius_mm))
            out[k] = 1.0 / (1.0 - math.cos(half))
    return out


def _below_flanks(view: _View, flank: SectionLines, fillets: Fillets) -> SectionLines:
    """The flanks as their fits together with the fillets have them; these are added."""
    place, angle, variances = np.full((view.s.size, 2), np.nan), np.full(view.s.size, np.nan), np.ones((2, view.s.size))
    sides, guess = view.sides, RADIUS_MM
    points = view.points([np.concatenate([one.face, one.arc]) for one in sides])
    noise = typical(np.sqrt(flank.offset_variance * [one.face.size for one in sides]), 0.02)
    for k, of in enumerate(points):
        found = None
        if np.isfinite(flank.angle[k]):
            found = fit_below_flank(of, flank.place[k], float(flank.angle[k]), noise, guess)
        if found is not None:
            (angle[k], variances[0, k], place[k], variances[1, k]), fillet = found
            guess = fillet.radius_mm
            fillets.add(k, fillet)
    if np.isnan(angle).all():
        raise InputError(
            view.cloud.source,
            f"in no profile are flank and fillet of the {('left', 'right')[view.which]} plate a line and an arc: "
            "does a root run, a bead or tape cover its root?",
        )
    return replace(flank, place=place, angle=angle, angle_variance=variances[0], offset_variance=variances[1])


def _outwards(view: _View, index: Sequence[int]) -> Int:
    """Columns (n,) of a point of each profile, negative where the groove lies towards column 0 from there."""
    rises = [(of[-1] >= of[0]) == (view.which == 0) for of in view.read.columns]
    return np.array([of[i] * (1 if up else -1) for of, i, up in zip(view.read.columns, index, rises, strict=True)])


def _ends(view: _View) -> Iterator[tuple[int, Int, Side, int]]:
    """Of each profile its number, its points' columns, the plate, and the other plate's innermost return."""
    for k, (columns, side, other) in enumerate(
        zip(view.read.columns, view.sides, view.read.sides[1 - view.which], strict=True)
    ):
        yield k, columns, side, int(other.below[(0, -1)[view.which]]) if other.below.size else other.last


def _hidden_by_nearer(view: _View) -> Bool:
    """Profiles (n,) in which something between the plates, nearer to the sensor, follows the last return of one."""
    out, way = np.zeros(len(view.sides), bool), (1, -1)[view.which]
    for k, columns, side, next_ in _ends(view):
        if not side.below.size and way * (next_ - side.last) > NEARER_RETURNS:
            at = columns[side.last + way * np.arange(NEARER_RETURNS + 1)]
            above = view.read.up * (view.cloud.z_mm[k, at[1:]] - view.cloud.z_mm[k, at[0]])
            out[k] = above.min() > NEARER_MM
    return out


def _next_up(view: _View) -> Float:
    """`Plate.next_up` (n,) of a side."""
    out = np.full(len(view.sides), np.nan)
    for k, columns, side, next_ in _ends(view):
        between = abs(next_ - side.last) - 1
        blank = abs(int(columns[next_]) - int(columns[side.last])) - 1 - between
        if not side.below.size and between <= MOST_BETWEEN and blank <= ADJOINS_COLUMNS:
            z = view.read.up * view.cloud.z_mm[k, columns[min(next_, side.last) : max(next_, side.last) + 1]]
            ends = (float(z[0]), float(z[-1])) if next_ > side.last else (float(z[-1]), float(z[0]))
            if between <= ADJOINS_RETURNS or z.min() > min(ends) - DROP_MM:
                out[k] = ends[1] - ends[0]
    return out


def _without_return(columns: Int, side: Side, which: int) -> int:
    """Columns without a return among the next ones from a side's last return towards the groove.

    Up to the third return: the first one may be a mixed pixel of the end.
    """
    beyond = min(max(side.last + (THIRD, -THIRD)[which], 0), columns.size - 1)
    return abs(int(columns[beyond]) - int(columns[side.last])) - abs(beyond - side.last)


def _lost(columns: Int, root: int) -> float:
    """Share without return among a face's columns next to the root's, between two that have one; NaN: too few."""
    away = np.abs(columns - root)
    away = away[away < LAST_COLUMNS]
    return 1.0 - (away.size - 2) / float(np.ptp(away) - 1) if away.size > LAST_COLUMNS // 4 else math.nan
