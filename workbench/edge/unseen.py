"""What a recording of a milled edge does not show of itself, and what that may cost this part (docs/method.md, 5)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, UPPER_SURFACE, Check, Cloud, MilledEdge, Quantity, Unseen
from workbench.artefacts.evidence import CUT_AWAY_MM, SCALE
from workbench.checks.judge import TURNS_DEG
from workbench.checks.residuals import UNSEEN_S
from workbench.checks.window import PINNED
from workbench.edge.faces import TrackedFaces
from workbench.edge.last_returns import is_free_end
from workbench.geometry.along import by_pass
from workbench.geometry.grids import columns_beyond, dark_beyond
from workbench.geometry.poses import in_planes, rotation_from_vector
from workbench.geometry.silhouette import MISSES
from workbench.units import COVERAGE, DEG, AnyArray, Bool, Float, Int, Shaped

TURN_DEG = 1.0  # of a hand-eye pose by design, or measured by hand
LAYER_MM = 0.05  # a coat of shop primer
PASSED_COLUMNS = 2.0  # by which an end moves more than others, at least, for the column that it stays in to cut it off
IN_QUARTILES = 2.44  # nine tenths of normal values, over its middle half
NEXT_COLUMNS = 2  # within these of its last return, something behind the face leaves no stripe of it unseen
MOST_FRAMES, LEAST_FRAMES = 200, 20  # that are looked at; that tell a thickness
DISAGREES = 3.0  # standard uncertainties

BY_NOMINAL = Unseen(
    "told_by_nominal",
    "That the faces are root face and bevel face, and not bevel face and upper surface: no more than a strip of the "
    "upper and of the lower surface is in view, so that nominal sizes alone tell.",
    is_doubt=True,
)
BY_TABLE = Unseen(
    "lies_on",
    "That what joins the root face's lower end is what the plate lies on: a stop that touches the root face further up "
    "looks alike.",
    is_doubt=True,
)
BY_BACKING = Unseen(
    "stands_behind",
    "That what returns behind the root face, parallel to it, beyond its lower end is another body, as a backing bar: a "
    "step that deep in the plate looks alike.",
    is_doubt=True,
)
BY_WINDOW = Unseen(
    "window_end",
    "That the face ends where its returns do: in nearly all frames the column beyond hardly ever returns, as where the "
    "sensor's window ends, or columns of it are blind. A scan that moves sideways by some columns on its way tells.",
    is_doubt=True,
)

VIEWS_DEG = 2.0  # between views: mirrored, a face would lie in directions twice as far apart
MIRRORS = np.array([np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, 1.0, -1.0])])  # of a profile's x or z

THICKNESS_U_MM = 0.02  # of a plate's thickness by a micrometer, here and there along the edge
BY_THICKNESS = {BY_BACKING.name, BY_WINDOW.name, "lost_columns", "shadow"}  # what the plate's thickness settles
COMPOUND = Unseen(
    "compound",
    "That the face beside the root face is the bevel that is meant: beyond it a further face follows, which "
    "inspect_preparation.json measures too.",
    is_doubt=True,
)


def unseen_of(cloud: Cloud, tracked: TrackedFaces, edge: MilledEdge, *, is_sharp: bool) -> tuple[Unseen, ...]:
    """What each may cost root face and bevel angle, of the size that its sentence says; is_sharp: declared so."""
    if not (np.isfinite(edge.root.value) & np.isfinite(edge.bevel.value)).any():
        return ()  # nothing was measured
    section = _Section.of(cloud, tracked, edge)
    bevel = float(np.nanmedian(edge.bevel.value))
    root = float(np.nanmedian(edge.root.value))
    found = []
    free = is_free_end(tracked)
    if free.sum() > 0.5 * tracked.seen.sum():
        steep = float(np.median(np.abs(section.slopes[0])))
        away = "An undercut" if is_sharp else "An undercut or a chamfer"
        found.append(
            Unseen(
                "shadow",
                f"{away} of {CUT_AWAY_MM:g} mm below the root face, in the shadow that it throws.",
                {"root_mm": CUT_AWAY_MM * (steep if is_sharp else max(steep, 1.0))},
            )
        )
        if ends_in_nothing(cloud.z_mm, tracked.end_column, free):
            lost_mm = max(CUT_AWAY_MM, float(np.nanmedian(tracked.root_end[free, 2])))
            found.append(
                Unseen(
                    "lost_columns",
                    f"All along the lower end of the root face, {lost_mm:.2g} mm of it that return nothing (columns "
                    "that the sensor loses, a dark stripe), or a burr in its plane.",
                    {"root_mm": lost_mm},
                )
            )
    if cloud.hand_eye_covariance is None:
        turns = [rotation_from_vector(TURN_DEG * DEG * axis) for axis in (*np.eye(3), *-np.eye(3))]
        found.append(
            Unseen(
                "hand_eye",
                f"A rotation of {TURN_DEG:g}° of the hand-eye pose in use, which states no uncertainty.",
                section.change(turns, root),
            )
        )
    found += _by_mirror(section, root) + _by_frame_order(cloud, edge)
    scales = [np.diag([1.0 + SCALE, 1.0, 1.0]), np.diag([1.0, 1.0, 1.0 + SCALE])]
    return (
        *found,
        Unseen("scale", "An error of 0.1 % of the profiler's scale.", section.change(scales, root)),
        Unseen(
            "clock_offset",
            f"An offset of {1000 * UNSEEN_S:g} ms between the clocks of profiler and robot, which moves values along "
            "the edge.",
            _by_clock(cloud, edge),
        ),
        Unseen(
            "layer",
            f"An even layer of {LAYER_MM:g} mm of paint, scale or coolant.",
            {"root_mm": LAYER_MM * math.tan(0.5 * bevel * DEG)},
        ),
    )


def by_thickness(
    cloud: Cloud, tracked: TrackedFaces, edge: MilledEdge, unseen: Sequence[Unseen], thickness_mm: float | None
) -> tuple[Unseen, ...]:
    """What is left of it where the plate's thickness is known: nothing of the end, or the doubt that this contradicts.

    The upper surface, in view, stands by the thickness above the lower edge wherever that was measured to be.
    """
    upper = tracked.faces[UPPER_SURFACE]
    rows = np.flatnonzero(tracked.seen & np.isfinite(edge.frame_arc_length_mm) & (upper.count > 2))
    if thickness_mm is None or rows.size < LEAST_FRAMES:
        return tuple(unseen)
    rows = rows[:: max(1, rows.size // MOST_FRAMES)]
    station = np.abs(edge.frame_arc_length_mm[rows, None] - edge.arc_length_mm[None]).argmin(axis=1)
    pose = cloud.base_from_profiler[rows, :3]
    out = np.cross(edge.tangent[station], pose[:, :, 0] + upper.slope[rows, None] * pose[:, :, 2])
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    place = in_planes(cloud.base_from_profiler[rows], upper.x_mean[rows], upper.z_mean[rows])
    found = float(np.nanmedian(np.abs(((place - edge.position_mm[station]) * out).sum(axis=1))))
    left = tuple(one for one in unseen if one.name not in BY_THICKNESS)
    if not abs(found - thickness_mm) > DISAGREES * math.hypot(float(np.nanmedian(edge.root.u)), THICKNESS_U_MM):
        return left
    sentence = (
        f"That the root face ends where its returns do: the plate is {thickness_mm:g} mm thick, and that end lies "
        f"{found:.3f} mm below its upper surface."
    )
    return (Unseen("thickness", sentence, {"root_mm": abs(found - thickness_mm)}, is_doubt=True), *left)


def ends_in_nothing(z_mm: AnyArray, outwards: Int, here: Bool) -> bool:
    """Is it nothing but missing returns in frames `here` (N,) that says where a face ends, after columns `outwards`?

    What returns from behind it right beside the end shows that nothing of the face lies there.
    """
    return bool((columns_beyond(z_mm, outwards)[here] > NEXT_COLUMNS).mean() > 0.5)


def fixed_end_check(cloud: Cloud, ends: Sequence[Int], frames: int) -> Check:
    """Whether a face ends where the part, the sensor's window and blind columns look alike: beside a dark column.

    ends (k,) each: last columns of a free end, in so many `frames` that show the face; below 0 towards column 0. Where
    the end moves over the columns, others of its frames light the next one; what returns from behind does so too.
    """
    share = max(float(dark_beyond(cloud.z_mm, cloud.keep, columns).sum()) for columns in ends) / frames
    finding = "the face ends where the part does, or not in one column"
    if share > PINNED:
        finding = (
            f"in {100 * share:.0f} % of the frames the face ends beside a column that hardly ever returns: an end "
            "of the window, or blind columns, would not show"
        )
    return Check("fixed_end_share", share, None, True, "an end of the part moves in the view as the part does", finding)


def cut_by_dark(cloud: Cloud, outwards: Int, place: Float, pitch: Float) -> Bool:
    """Frames (N,) in which a face does not end where its returns do: a dark column, over which it moves, ends these.

    outwards (N,): columns as `columns_to_next` takes them; place (N,): where returns end beside the part, in mm along
    its surface; pitch (N,): of the columns there, mm. An end of the part that stays in one column moves in it no more
    than others do.
    """
    cut, known = np.zeros(outwards.size, bool), np.isfinite(place)
    dark = dark_beyond(cloud.z_mm, cloud.keep, outwards) & known
    rest = place[known & ~dark]
    usual = IN_QUARTILES * float(np.diff(np.quantile(rest, [0.25, 0.75]))[0]) if rest.size >= LEAST_FRAMES else 0.0
    for group, last in np.unique(np.stack([cloud.pass_index[dark], outwards[dark]]), axis=1).T:
        for column in range(last, last - MISSES, -1):  # the last returns may be lost, too
            at = known & (cloud.pass_index == group) & (outwards == column)
            if at.any() and np.ptp(np.quantile(place[at], [0.05, 0.95])) > usual + PASSED_COLUMNS * np.median(pitch):
                cut |= at
            elif column == last:
                break
    return np.asarray(cut | (cut.mean() > PINNED))  # what the few others show is no end either


def root_end_check(cloud: Cloud, tracked: TrackedFaces) -> Check:
    """Likewise of a root face."""
    return fixed_end_check(cloud, [tracked.end_column[is_free_end(tracked)]], int(tracked.seen.sum()))


def by_window(check: Check) -> tuple[Unseen, ...]:
    """The doubt of a root face that ends so."""
    return (BY_WINDOW,) if (check.value or 0.0) > PINNED else ()


class _Section:
    """The two faces of some frames (f,): their slopes in the profiler frame, and its orientation beside the edge's."""

    def __init__(
        self, slopes: Shaped[Float, "2 f"], base_from_profiler: Float, tangent: Float, drift: Float, views_deg: float
    ) -> None:
        """Drift (f, 3): mm in the profiler frame by which the faces move a mm along the edge.

        views_deg: angle between the views in the section.
        """
        self.slopes, self.views_deg = slopes, views_deg
        self._turn = base_from_profiler
        self._tangent, self._drift = tangent, drift
        self._before = self._shape(np.eye(3))

    @classmethod
    def of(cls, cloud: Cloud, tracked: TrackedFaces, edge: MilledEdge) -> _Section:
        """Of frames that show both, evenly over the edge."""
        faces = [tracked.faces[label] for label in (ROOT_FACE, BEVEL_FACE)]
        on = tracked.seen & np.isfinite(edge.frame_arc_length_mm)
        on &= np.all([one.count > 2 for one in faces], axis=0)
        rows = np.flatnonzero(on)
        rows = rows[:: max(1, rows.size // MOST_FRAMES)]
        station = np.abs(edge.frame_arc_length_mm[rows, None] - edge.arc_length_mm[None]).argmin(axis=1)
        slopes = np.array([one.slope[rows] for one in faces])
        drift, s = np.zeros((rows.size, 3)), edge.frame_arc_length_mm[rows]
        place = np.stack([faces[0].x_mean[rows], faces[0].z_mean[rows]], axis=1)
        for here in by_pass(cloud.pass_index[rows]):
            if np.ptp(s[here]) > 0.0:
                drift[here, ::2] = np.polyfit(s[here], place[here], 1)[0]
        turn = cloud.base_from_profiler[rows, :3, :3]
        right, up = ((turn[:, :, 2] * of[station]).sum(axis=1) for of in (edge.normal, edge.across))
        views = np.unwrap(np.arctan2(up, right))
        return cls(slopes, turn, edge.tangent[station], drift, float(np.ptp(views)) / DEG)

    def _shape(self, profiler: Shaped[Float, "3 3"]) -> tuple[Float, Float]:
        """Length (f,) of the root face in the section by that in the frame, and bevel angle (f,) in rad."""
        lines = np.stack([np.ones_like(self.slopes), np.zeros_like(self.slopes), self.slopes], axis=-1)
        rotated = np.einsum("fij,jk,nfk->nfi", self._turn, profiler, lines)
        tangent = self._tangent + np.einsum("fij,jk,fk->fi", self._turn, profiler - np.eye(3), self._drift)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        across = rotated - np.einsum("nfi,fi->nf", rotated, tangent)[..., None] * tangent
        length = np.linalg.norm(across, axis=-1)
        cosine = (across[0] * across[1]).sum(axis=-1) / (length[0] * length[1])
        return length[0] / np.linalg.norm(lines[0], axis=-1), np.arccos(np.clip(cosine, -1.0, 1.0))

    def change(self, profilers: list[Float], root_mm: float) -> dict[str, float]:
        """By how much root face, mm, and bevel angle, deg, change at most where returns are taken through one of these.

        profilers: maps (3, 3) of profiler coordinates.
        """
        length, angle = self._before
        after = [self._shape(one) for one in profilers]
        return {
            "root_mm": max(root_mm * abs(float(np.median(one / length - 1.0))) for one, _ in after),
            "bevel_deg": max(abs(float(np.median(one - angle))) / DEG for _, one in after),
        }


def _by_mirror(section: _Section, root_mm: float) -> list[Unseen]:
    """That no axis of profiler or robot is mirrored, where one view of the edge alone does not show it.

    Two views of mirrored profiles put each face in two directions, twice as far apart as the views are.
    """
    if section.views_deg > VIEWS_DEG:
        return []
    words = f"Mirrored axes of profiler or robot: the edge is seen from one side, within {section.views_deg:.1f}°."
    return [Unseen("mirrored_axes", words, section.change(list(MIRRORS), root_mm))]


def _by_frame_order(cloud: Cloud, edge: MilledEdge) -> list[Unseen]:
    """That the frames of one pass came in the order of its poses, where values differ by more than U from either end.

    A plate that passes does so in either order, so that no verdict rests on it: values lie in another place.
    """
    turned = next((one.value for one in cloud.checks if one.name == "flange_turn_deg"), None)
    if turned is None or turned >= TURNS_DEG or np.unique(cloud.pass_index).size > 1:
        return []
    sizes = edge.root, edge.bevel
    apart = {one.name: float(np.nanmax(np.abs(one.value - one.value[::-1]), initial=0.0)) for one in sizes}
    if all(apart[one.name] <= COVERAGE * np.nanmedian(one.u) for one in sizes):
        return []
    sentence = f"That the frames came in the order of the poses: the flange rotates by {turned:.1f}° only, and in "
    sentence += "reverse order values would lie in the mirrored place along the edge."
    return [Unseen("frame_order", sentence, apart, exchanges=True)]


def _by_clock(cloud: Cloud, edge: MilledEdge) -> dict[str, float]:
    """What values change over the way of UNSEEN_S, where they change fast (95 % of the edge less)."""
    at, time = edge.frame_arc_length_mm, cloud.time_s
    step = np.diff(time)
    speed = np.abs(np.diff(at))[step > 0.0] / step[step > 0.0]
    if not np.isfinite(speed).any():
        return {"root_mm": 0.0}
    way = UNSEEN_S * float(np.nanmedian(speed))

    def change(size: Quantity) -> float:
        slope = np.abs(np.gradient(size.value, edge.arc_length_mm))
        return way * float(np.nanpercentile(slope, 95)) if np.isfinite(slope).any() else 0.0

    return {one.name: change(one) for one in (edge.root, edge.bevel)}
