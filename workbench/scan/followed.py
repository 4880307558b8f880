"""What of a planned scan was done, and what was not done as planned."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from workbench.artefacts import Check, Cloud
from workbench.geometry.moves import chords_mm
from workbench.geometry.poses import inverse, pose_from, rotation_from_quaternion, vector_from_rotation
from workbench.result_files import ScanPlanFile
from workbench.result_files.scan_plan import ScanPassRow, plan_id
from workbench.units import DEG, Float

AWAY_MM, AWAY_DEG = 2.0, 2.0  # off the planned pose: what taught points and a pose log leave open is less
WIDE_MM = 3.0  # of the edge without a frame
PITCH_SHARE = 0.1
OTHER_MM = 50.0  # from the poses of every planned pass: another pass
REASON = "reported, not refused: u is that of the scan as recorded"


def followed(cloud: Cloud, file: Path) -> tuple[Check, bool]:
    """The passes of a cloud against those of a scan-plan.json: how many things were not done as planned, and which.

    And whether any of its passes was driven at all.

    Raises:
        InputError: no such file.
    """
    plan = ScanPlanFile.read(file)
    named, this = cloud.part.scan_plan, plan_id(file.read_bytes())
    found = [] if named in (None, this) else [f"the recording names plan {named}, {file.name} is {this}"]
    if plan.columns not in (None, cloud.x_mm.shape[1]):
        found.append(f"{cloud.x_mm.shape[1]} columns, planned {plan.columns}")
    done: dict[int, list[int]] = {}
    planned = [_poses(one) for one in plan.passes]
    for number in np.unique(cloud.pass_index).tolist():
        poses = cloud.base_from_profiler[cloud.pass_index == number]
        away = [
            float(np.median(_apart_mm(poses, one, row.standoff_mm)))
            for one, row in zip(planned, plan.passes, strict=True)
        ]
        if min(away) > OTHER_MM:
            found.append(f"recorded pass {number} lies {min(away):.0f} mm from every planned one")
        else:
            done.setdefault(int(np.argmin(away)), []).append(number)
    for k, row in enumerate(plan.passes):
        of = f"pass {row.index} ({row.elevation_deg:.0f} deg)"
        frames = np.isin(cloud.pass_index, done.get(k, []))
        wrong = _departures(cloud.base_from_profiler[frames], planned[k], row) if k in done else ["missing"]
        found += [f"{of}: {one}" for one in wrong]
    finding = "; ".join(found) or "done as planned"
    return Check("scan_plan_departures", float(len(found)), 0.0, not found, REASON, finding), bool(done)


def _poses(row: ScanPassRow) -> Float:
    """base_from_profiler (k, 4, 4) as planned."""
    turns = rotation_from_quaternion(np.array([one.quaternion_wxyz for one in row.points]))
    return pose_from(turns, np.array([one.position_mm for one in row.points]))


def _nearest(poses: Float, planned: Float) -> np.ndarray:
    """Of each pose (n,) the planned one that stands nearest."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(planned[:, :3, 3]).query(poses[:, :3, 3])[1])


def _apart_mm(poses: Float, planned: Float, standoff_mm: float) -> Float:
    """How far poses (n,) are from a planned pass: the way, and the turn at the stand-off."""
    off = inverse(planned[_nearest(poses, planned)]) @ poses
    turn = np.linalg.norm(vector_from_rotation(off[:, :3, :3]), axis=1)
    return np.asarray(np.linalg.norm(off[:, :3, 3], axis=1) + standoff_mm * turn)


def _departures(poses: Float, planned: Float, row: ScanPassRow) -> Iterator[str]:
    """What of a pass was not done as planned, with its size."""
    near = _nearest(poses, planned)
    s = np.array([one.arc_length_mm for one in row.points])
    at, off = s[near], inverse(planned[near]) @ poses
    edges = np.concatenate([[s[0]], np.sort(at), [s[-1]]])
    for k in np.flatnonzero(np.diff(edges) > max(WIDE_MM, 3.0 * row.frame_pitch_mm)):
        yield f"no frame from {edges[k]:.0f} to {edges[k + 1]:.0f} mm"
    for name, turn in zip(
        ("lead", "elevation", "turn about the rays"), vector_from_rotation(off[:, :3, :3]).T, strict=True
    ):
        worst = int(np.abs(turn).argmax())
        if abs(turn[worst]) > AWAY_DEG * DEG:
            yield f"{name} off by {abs(turn[worst]) / DEG:.1f} deg at {at[worst]:.0f} mm"
    inner = (near > 0) & (near < len(s) - 1)  # beyond its ends a pass may go on
    place = np.where(inner[:, None], off[:, :3, 3], 0.0)
    away = np.hypot(place[:, 0], place[:, 2])
    if away.max() > AWAY_MM:
        yield f"{away.max():.1f} mm beside the planned way at {at[int(away.argmax())]:.0f} mm"
    pitch = float(np.median(chords_mm(poses[:, :3, 3]))) if len(poses) > 1 else math.nan
    if abs(pitch / row.frame_pitch_mm - 1.0) > PITCH_SHARE:
        yield f"a frame every {pitch:.2g} mm, planned {row.frame_pitch_mm:.2g}"
