"""Where the part stands in the robot's base: what shows it, and what is left to be wrong.

A scan gives an edge its shape. That the edge lies where the recording says rests on poses, hand-eye, clocks and axes
that one recording in one orientation cannot show to be wrong. So a path is a *shape only* until something independent
says where the part is: points that the robot's own tool touched, a second orientation of the scanner that sees the edge
in the same place, a calibration of the hand-eye that is not old, or a stop of the program at which the operator looks.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date
from itertools import combinations
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field
from scipy.special import chdtrc

from workbench.artefacts import Check, Cloud, Edge, Toolpath
from workbench.artefacts.decisions import SHAPE_ONLY
from workbench.geometry.poses import inverse, vector_from_rotation
from workbench.units import DEG, Float

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
Points = Annotated[list[tuple[Coordinate, Coordinate, Coordinate]], Field(min_length=1, max_length=50)]
TOUCHED_MM = 0.5  # from the scanned surface, of a point that the tool touched: both of one place
AROUND_MM = 4.0  # of a touched point, in which the scan tells the surface
LEAST_RETURNS, LEAST_OF_FACE = 12, 0.2  # and share of the returns there: scattered ones lie near any plane
FITS = 10  # of a face to the returns that lie in it
GROSS_MM, GROSS = 50.0, 10.0 * DEG  # by which a scan may stand elsewhere, where nothing says where
CHANCE = 1e-3  # that points touched as well as that lie as far to one side
KNOWN_MM = 1.0  # how well points that were touched must tell the edge's place beside it, coverage 2
ANOTHER_DEG, ABOUT_EDGE = 10.0, 0.9  # of the scanner in a second orientation; cosine of its axis with the edge
CALIBRATED_DAYS = 90  # before the recording


class Place(NamedTuple):
    """What is known of the part's place."""

    faults: list[str]  # touched points that lie elsewhere than the scan
    shape_only: str  # begins with SHAPE_ONLY; '' where something shows the place
    unseen: list[str]  # what each direction that is left may cost, mm


def place_of(toolpath: Toolpath, edge: Edge, cloud: Cloud, touched_mm: Points | None, known: bool) -> Place:
    """What shows where the part stands.

    Args:
        toolpath: the path, with the checks of its recording.
        edge: its edge.
        cloud: the scan.
        touched_mm: points of the part's surface in the base, where the robot's tool touched them.
        known: whether the part is the pipeline's own, as in the twin.
    """
    faults, left_mm = _touched(edge, cloud, touched_mm or [])
    if known or (touched_mm and left_mm <= KNOWN_MM):
        return Place(faults, "", [])
    unseen = list(_costs(toolpath, cloud))
    if _two_orientations(edge, cloud, toolpath.evidence) or _calibrated(cloud):
        return Place(faults, "", unseen)
    found = f"; the touched points leave {left_mm:.1f} mm open" if touched_mm else ""
    needed = "touched_mm, a second orientation of the scanner, a dated hand-eye calibration, or a probe in the cell"
    return Place(
        faults, f"{SHAPE_ONLY}nothing shows where the part stands in the robot's base ({needed}){found}", unseen
    )


def _touched(edge: Edge, cloud: Cloud, touched: Points) -> tuple[list[str], float]:
    """Points off the scanned surface, in words, and how far the edge may still lie elsewhere beside itself, mm.

    The scan as a rigid body that stands elsewhere by GROSS_MM and GROSS; each point tells its distance along the
    surface's normal. What is left is the part of it that moves the edge across. Points that agree with each other on
    another place, beyond chance, are a fault as well.
    """
    seen, along = edge.position_mm[edge.seen], edge.tangent[edge.seen]
    middle = seen.mean(axis=0)
    points, rows, away, faults = cloud.points_mm if touched else np.empty((0, 3)), [], [], []
    for i, place in enumerate(np.array(touched, float).reshape(-1, 3)):
        near = points[(np.abs(points - place) < AROUND_MM).all(axis=1)]
        face = _face(near, place)
        if face is None:
            faults.append(f"touched point {i + 1} lies nowhere on the scanned surface: another part, or another place")
            continue
        centre, normal = face
        off = float(normal @ (place - centre))
        if abs(off) > TOUCHED_MM:
            faults.append(
                f"touched point {i + 1} lies {abs(off):.2f} mm off the scanned surface, at most {TOUCHED_MM:g}"
            )
        rows.append(np.append(normal, np.cross(place - middle, normal)))
        away.append(off)
    prior = np.diag([GROSS_MM**-2.0] * 3 + [GROSS**-2.0] * 3)
    slope, told = np.array(rows).reshape(-1, 6), np.array(away)
    information = prior + slope.T @ slope / (TOUCHED_MM / 2) ** 2
    left = np.linalg.inv(information)
    moved = left @ slope.T @ told / (TOUCHED_MM / 2) ** 2
    freedom = 6.0 - float(np.trace(left @ prior))  # directions that the points tell
    if not faults and rows and chdtrc(freedom, moved @ information @ moved) < CHANCE:
        far = np.linalg.norm(moved[:3])
        where = ", ".join(f"{value:+.2f}" for value in moved[:3])
        faults.append(
            f"the touched points lie {far:.2f} mm beside the scan, together, by ({where}) mm in the base: has the part "
            "moved since, are hand-eye and tool tip right?"
        )
    worst = 0.0
    for place, tangent in zip(seen[:: max(len(seen) // 20, 1)], along[:: max(len(along) // 20, 1)], strict=True):
        moves = np.hstack([np.eye(3), np.cross(place - middle, np.eye(3))])
        across = np.eye(3) - np.outer(tangent, tangent)
        spread = across @ moves @ left @ moves.T @ across
        worst = max(worst, 2.0 * float(np.sqrt(np.linalg.eigvalsh(spread)[-1])))
    return faults, worst


def _face(near: Float, place: Float) -> tuple[Float, Float] | None:
    """Middle and normal of the face on which a place lies, grown from the returns nearest; None: there is none."""
    order = np.argsort(np.linalg.norm(near - place, axis=1))
    found: list[tuple[int, Float, Float]] = []
    least = max(LEAST_RETURNS, LEAST_OF_FACE * len(near))
    if len(near) < least:
        return None
    for few in (LEAST_RETURNS, 4 * LEAST_RETURNS, 16 * LEAST_RETURNS):
        belongs = np.zeros(len(near), bool)
        belongs[order[:few]] = True
        for _ in range(FITS):
            centre = near[belongs].mean(axis=0)
            normal = np.linalg.svd(near[belongs] - centre, full_matrices=False)[2][2]
            belongs = np.abs((near - centre) @ normal) < TOUCHED_MM / 2
            if belongs.sum() < least:
                break
        else:
            found.append((int(belongs.sum()), centre, normal))
    return max(found, key=lambda one: one[0])[1:] if found else None


def _two_orientations(edge: Edge, cloud: Cloud, evidence: tuple[Check, ...]) -> bool:
    """Whether two passes, turned about the edge against each other, see it in one place: a hand-eye's error shows."""
    agrees = any(one.name == "pass_disagreement_mm" and one.passed and one.value is not None for one in evidence)
    if not agrees:
        return False
    tangent = edge.tangent[edge.seen].mean(axis=0)
    tangent /= np.linalg.norm(tangent)
    middles = [np.flatnonzero(cloud.pass_index == number) for number in np.unique(cloud.pass_index)]
    turns = [cloud.base_from_profiler[frames[len(frames) // 2], :3, :3] for frames in middles]
    for one, other in combinations(turns, 2):
        turn = vector_from_rotation(one @ other.T)
        size = float(np.linalg.norm(turn))
        if size > ANOTHER_DEG * DEG and abs(turn @ tangent) > ABOUT_EDGE * size:
            return True
    return False


def _calibrated(cloud: Cloud) -> bool:
    """Whether the hand-eye was calibrated, with its covariance, no longer before the recording than CALIBRATED_DAYS."""
    part = cloud.part
    if cloud.hand_eye_covariance is None or not (part.hand_eye_calibrated_at and part.recorded_at):
        return False
    then, now = (date.fromisoformat(text[:10]) for text in (part.hand_eye_calibrated_at, part.recorded_at))
    return 0 <= (now - then).days <= CALIBRATED_DAYS


def _costs(toolpath: Toolpath, cloud: Cloud) -> Iterator[str]:
    """What errors that this scan cannot show would move the path by."""
    points = toolpath.in_base(np.concatenate([layer.position_mm for layer in toolpath.layers]))
    if cloud.flange_from_profiler is None:
        lever = np.abs(points).mean(axis=0)
        per_degree = _mm_a_degree(points)
        yield f"the cloud's frame: turned by 1 deg about the base's x, y, z it moves the path by {per_degree} mm"
        mirrored = ", ".join(f"{2 * value:.0f}" for value in lever)
        yield f"the cloud's handedness: mirrored in x, y, z it moves the path by {mirrored} mm"
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        yield f"the cloud's scale: 1 % is {0.01 * size:.1f} mm along the path"
        return
    frames = np.linspace(0, len(cloud.base_from_profiler) - 1, 9).astype(int)
    flange = cloud.base_from_profiler[frames] @ inverse(cloud.flange_from_profiler)
    nearest = np.linalg.norm(points[None] - flange[:, None, :3, 3], axis=2).argmin(axis=1)
    arms = np.einsum("nji,nj->ni", flange[:, :3, :3], points[nearest] - flange[:, :3, 3])
    yield f"the hand-eye pose: turned by 1 deg about the flange's x, y, z it moves the path by {_mm_a_degree(arms)} mm"
    yield "the hand-eye pose and the robot's positions: 1 mm beside is 1 mm of the path"
    if cloud.recorded_flange_from_profiler is None:
        return
    other = cloud.recorded_flange_from_profiler @ inverse(cloud.flange_from_profiler)
    away = np.linalg.norm(arms @ other[:3, :3].T + other[:3, 3] - arms, axis=1)
    if away.max() > TOUCHED_MM:
        yield (
            f"which hand-eye pose is right: by the recording's own the path lies {away.max():.1f} mm elsewhere than by "
            f"{cloud.part.hand_eye}"
        )


def _mm_a_degree(arms: Float) -> str:
    """What 1 deg about x, y, z moves the ends of arms (n, 3) by, on the whole, mm."""
    away = [np.sqrt((np.delete(arms, axis, axis=1) ** 2).sum(axis=1).mean()) for axis in range(3)]
    return ", ".join(f"{DEG * far:.1f}" for far in away)
