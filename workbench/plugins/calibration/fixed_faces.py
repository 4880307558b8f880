"""The measurement model of a fixed part: points in the profiler frame lie on planes, or on straight lines, of the base.

With (A, b) the flange's pose and (R, t) the hand-eye pose, a point p of the profile lies at P = A (R p + t) + b. Of a
plane through a with normal w, w (P - a) = 0; of a line through a along w, u (P - a) = v (P - a) = 0. The profiler's x
and z may count too much, within what is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.api import Float, Int, Recording, Shaped, estimator, rotation_from_vector
from workbench.plugins.calibration.model import MOST_TURN, Estimate, Noise
from workbench.plugins.calibration.observations import Flange, Timed, flange_of, grouped, sharing
from workbench.plugins.calibration.profile_lines import Marks, Target

START_ROUNDS = 4  # of the directions of lines, in turn with the translation
SCALES = 2


@dataclass(frozen=True)
class At:
    """A point in the space of unknowns: the hand-eye pose and clock of `pose`, the part's faces, the scales."""

    pose: Estimate
    frame: Shaped[Float, "F 3 3"]  # rows u, v, w: w is a plane's normal, or along a line
    place_mm: Shaped[Float, "F 3"]  # on it
    scale: Shaped[Float, " 2"]  # relative errors of x and z


@dataclass(frozen=True)
class Part:
    """What is measured with: marks of frames on faces of a fixed part. k observations of D distances each."""

    marks: Marks
    target: Target
    flange: Flange | Timed  # at the marks
    noise: Noise
    scale_u: float

    @property
    def what(self) -> str:
        """It is, in words."""
        return "point" if self.target == "points" else self.target

    @property
    def with_offset(self) -> bool:
        """Whether the offset of the profiles' clock is unknown."""
        return isinstance(self.flange, Timed)

    @property
    def faces(self) -> int:
        """Planes or lines."""
        points = int(self.marks.point_mm.shape[1])
        return points if self.target == "points" else points // 2

    @property
    def shifts(self) -> tuple[int, ...]:
        """Axes of a face along which its place is unknown."""
        return (0, 1) if self.target == "points" else (2,)

    @property
    def size(self) -> int:
        """Unknowns: t, w, each face's two turns and shifts, the scales, the clock's offset."""
        return 6 + self.faces * (2 + len(self.shifts)) + SCALES + self.with_offset

    @property
    def pairs(self) -> list[tuple[int, int, int]]:
        """Of every distance: which point, of which face, along which of its axes."""
        if self.target == "points":
            return [(k, k, axis) for k in range(self.faces) for axis in (0, 1)]
        return [(2 * k + end, k, 2) for k in range(self.faces) for end in (0, 1)]

    @property
    def middle_mm(self) -> Float:
        """What the scales leave where it is."""
        return np.asarray(self.marks.point_mm.mean(axis=(0, 1)))

    @staticmethod
    def pose(at: At) -> Estimate:
        """With the clock's offset."""
        return at.pose

    def shown(self, at: At) -> Float:
        """The middles of the marks, in the laser plane."""
        return np.insert(self.marks.point_mm.mean(axis=1), 1, 0.0, axis=1)

    def searched(self, most: int, flange: Flange | None = None) -> Part:
        """Of observations spread over all; another flange has no clock."""
        count = len(self.marks.frame)
        some = np.isin(np.arange(count), np.linspace(0, count - 1, most).astype(int))
        columns = ("frame", "point_mm", "covariance")
        marks = self.marks._replace(**{name: getattr(self.marks, name)[some] for name in columns})
        return replace(self, marks=marks, flange=(flange or self.flange).subset(some))

    def rows(self, at: At) -> estimator.Rows:
        """Distances from the faces, all of them 0 as measured."""
        seen = self.flange.at(at.pose.offset_s)
        A, b = seen.base_from_flange[:, :3, :3], seen.base_from_flange[:, :3, 3]
        away = self.marks.point_mm - self.middle_mm
        rotated = (self.middle_mm + away / (1.0 + at.scale)) @ at.pose.rotation[:, [0, 2]].T  # R p (k, Q, 3)
        lever = rotated + at.pose.translation_mm
        point = np.einsum("kij,kqj->kqi", A, lever) + b[:, None]
        which, face, axis = (np.array(one) for one in zip(*self.pairs, strict=True))
        normal, off = at.frame[face, axis], point[:, which] - at.place_mm[face]
        here = np.einsum("kji,dj->kdi", A, normal)  # the normals in the flange's axes
        jacobian = np.zeros((len(A), len(which), self.size))
        jacobian[..., :3] = here
        jacobian[..., 3:6] = np.cross(rotated[:, which], here)
        per_face, by_turn = 2 + len(self.shifts), np.cross(at.frame[face, :2], normal[:, None])
        for d, (k, a) in enumerate(zip(face, axis, strict=True)):
            first = 6 + per_face * k
            jacobian[:, d, first : first + 2] = off[:, d] @ by_turn[d].T
            jacobian[:, d, first + 2 + self.shifts.index(a)] = -1.0
        by_x_z = here @ at.pose.rotation[:, [0, 2]]  # (k, D, 2): of each distance by its point
        behind = 6 + per_face * self.faces
        jacobian[..., behind : behind + SCALES] = -by_x_z * away[:, which]
        if self.with_offset:
            moving = seen.velocity[:, None, :3] + np.cross(seen.velocity[:, None, 3:], lever[:, which])
            jacobian[..., -1] = -(here * moving).sum(axis=2)
        spread = np.concatenate([np.broadcast_to(normal, here.shape), np.cross(lever[:, which], here)], axis=2)
        own = spread * self.noise.spread
        by_marks = np.einsum("kdi,kdij,kej->kde", by_x_z, self.marks.covariance[:, which], by_x_z)
        alone = np.where(which[:, None] == which, by_marks, 0.0)  # two distances of one point share its errors
        prior, away = np.zeros((self.size, self.size)), np.zeros(self.size)
        scales = np.arange(behind, behind + SCALES)
        prior[scales, scales], away[scales] = self.scale_u**-2, -at.scale
        return estimator.Rows(
            residual=-(off * normal).sum(axis=2),
            jacobian=jacobian,
            covariance=alone + seen.evened[:, None, None] * (own @ own.mT),
            values=np.full(len(A), float(len(which))),
            prior=prior,
            away=away,
            shared=tuple(sharing(scan, alone, own, own[..., :0]) for scan in seen.scans),
        )

    def moved(self, at: At, step: Float) -> At:
        """Turns by half a rad at most: beyond, the model is no plane."""
        per_face = 2 + len(self.shifts)
        each = step[6 : 6 + per_face * self.faces].reshape(self.faces, per_face)
        turns = np.concatenate([[step[3:6]], np.pad(each[:, :2], ((0, 0), (0, 1)))])
        less = min(1.0, MOST_TURN / max(np.linalg.norm(turns, axis=1).max(), 1e-12))
        each = less * each
        turn = rotation_from_vector(np.einsum("fa,fai->fi", each[:, :2], at.frame[:, :2]))
        shift = np.einsum("fa,fai->fi", each[:, 2:], at.frame[:, list(self.shifts)])
        pose = at.pose.moved(np.concatenate([less * step[:6], np.zeros(4), less * step[-1:] * self.with_offset]))
        behind = 6 + per_face * self.faces
        scale = at.scale + less * step[behind : behind + SCALES]
        return At(pose, np.einsum("fij,faj->fai", turn, at.frame), at.place_mm + shift, scale)

    def starts(self, rotations: Float, offsets_s: Float, most: int) -> list[tuple[float, At]]:
        """Translation and faces by linear least squares."""
        placed = [(offset_s, self.flange.at(offset_s)) for offset_s in offsets_s.tolist()]
        begun = [self.start(R, seen, offset_s) for offset_s, seen in placed for R in rotations]
        return sorted(begun, key=lambda one: one[0])

    def start(self, R: Float, seen: Flange, offset_s: float) -> tuple[float, At]:
        """The answer from one rotation, and the sum of its squared distances before it."""
        A, b = seen.base_from_flange[:, :3, :3], seen.base_from_flange[:, :3, 3]
        rotated = self.marks.point_mm @ R[:, [0, 2]].T
        base = np.einsum("kij,kqj->kqi", A, rotated) + b[:, None]  # but for A t
        t, size = np.zeros(3), self.faces
        frame, place = np.tile(np.eye(3), (size, 1, 1)), np.zeros((size, 3))
        for _ in range(START_ROUNDS if self.target == "points" else 1):
            point = base + (A @ t)[:, None]
            for k in range(size):
                if self.target == "points":
                    axes = np.linalg.svd(point[:, k] - point[:, k].mean(axis=0), full_matrices=False)[2]
                    frame[k] = axes[[1, 2, 0]]
                else:
                    frame[k] = np.linalg.svd(base[:, 2 * k + 1] - base[:, 2 * k], full_matrices=False)[2]
                frame[k] *= np.linalg.det(frame[k])
            t, place, left = self._linear(A, base, frame)
        return left, At(Estimate(R, t, np.zeros(3), 0.0, offset_s), frame, place, np.zeros(SCALES))

    def _linear(self, A: Float, base: Float, frame: Float) -> tuple[Float, Float, float]:
        """Translation, places of the faces, and the sum of the squared distances, for faces turned as given."""
        columns, side = [], []
        for which, face, axis in self.pairs:
            normal = frame[face, axis]
            level = np.zeros((len(A), 3 * self.faces))
            level[:, 3 * face + axis] = -1.0
            columns.append(np.concatenate([np.einsum("kji,j->ki", A, normal), level], axis=1))
            side.append(-base[:, which] @ normal)
        matrix, target = np.concatenate(columns), np.concatenate(side)
        answer = np.linalg.lstsq(matrix, target, rcond=1e-9)[0]
        place = np.einsum("fa,fai->fi", answer[3:].reshape(-1, 3), frame)
        return answer[:3], place, ((matrix @ answer - target) ** 2).sum()


def part_of(
    recording: Recording, marks: Marks, target: Target, noise: Noise, scale_u: float, search_s: float
) -> tuple[Part, Int]:
    """The marks joined with the flange's poses, repeats of a posture averaged; and the frame that each begins with.

    `search_s`: by which the clocks may be apart.
    """
    groups = grouped(recording, marks.frame, search_s)
    means = [(marks.point_mm[g].mean(0), marks.covariance[g].mean(0) / len(g)) for g in groups]
    first = marks.frame[[g[0] for g in groups]]
    points, covariance = (np.array(one) for one in zip(*means, strict=True))
    joined = marks._replace(frame=first, point_mm=points, covariance=covariance)
    flange = flange_of(recording, recording.time_s[first], recording.pass_index[first], search_s > 0)
    return Part(joined, target, flange, noise, scale_u), first
