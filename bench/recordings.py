"""A recording with other frames, columns or poses than it has, or as tables."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.artefacts import Recording
from workbench.geometry.poses import quaternion_from_rotation
from workbench.scan.fuse_stage import flange_poses
from workbench.units import Float


def with_values(r: Recording, **changes: Any) -> Recording:
    return dataclasses.replace(r, **changes)


def with_grid(r: Recording, x_mm: Float, z_mm: Float) -> Recording:
    """Another grid of as many frames."""
    return with_values(r, x_mm=np.ascontiguousarray(x_mm, np.float32), z_mm=np.ascontiguousarray(z_mm, np.float32))


def frames(r: Recording, at: Any) -> Recording:
    """Some frames, in their order, and the poses of their passes."""
    light = None if r.intensity is None else r.intensity[at]
    there = np.isin(r.robot_pass, r.pass_index[at])
    return with_values(
        r,
        time_s=r.time_s[at],
        x_mm=r.x_mm[at],
        z_mm=r.z_mm[at],
        pass_index=r.pass_index[at],
        intensity=light,
        robot_time_s=r.robot_time_s[there],
        robot_position_mm=r.robot_position_mm[there],
        robot_quaternion_wxyz=r.robot_quaternion_wxyz[there],
        robot_pass=r.robot_pass[there],
    )


def stamped(r: Recording, time_s: Float) -> Recording:
    """Frames at other times (N,), without brightness; those that lie beyond the poses of their pass are lost."""
    poses = {number: r.robot_time_s[r.robot_pass == number] for number in np.unique(r.pass_index)}
    first, last = np.array([(poses[number].min(), poses[number].max()) for number in r.pass_index]).T
    keep = (time_s >= first) & (time_s <= last)
    return with_values(frames(r, keep), time_s=time_s[keep], intensity=None)


def columns(r: Recording, at: Any) -> Recording:
    """Some columns."""
    x, z, light = (None if g is None else np.ascontiguousarray(g[:, at]) for g in (r.x_mm, r.z_mm, r.intensity))
    return with_values(r, x_mm=x, z_mm=z, intensity=light)


def told(r: Recording, place_mm: Float, turn: Float, **changes: Any) -> Recording:
    """One pose per frame: places (n, 3) and rotations (n, 3, 3) of the flange in the base."""
    return with_values(
        r,
        robot_time_s=r.time_s,
        robot_position_mm=place_mm,
        robot_quaternion_wxyz=quaternion_from_rotation(turn),
        robot_pass=r.pass_index,
        **changes,
    )


def dense_stream(r: Recording) -> Recording:
    """The same poses, told at every frame's time."""
    poses = flange_poses(r)
    return told(r, poses[:, :3, 3], poses[:, :3, :3])


BLOCK = 1000  # frames that are written at once
SHIFT_MM = np.array([300.0, -200.0, 50.0])
TURN = Rotation.from_rotvec([0.0, 0.0, 1.27]).as_matrix()


def moved(r: Recording) -> Recording:
    """The robot's base elsewhere, and turned by 73 deg."""
    poses = flange_poses(r)
    return told(r, poses[:, :3, 3] @ TURN.T + SHIFT_MM, TURN @ poses[:, :3, :3])


def mirrored(r: Recording) -> Recording:
    """All of it in a mirror: x of sensor, flange and base."""
    poses, m = flange_poses(r), np.diag([-1.0, 1.0, 1.0, 1.0])
    place, turn = poses[:, :3, 3] * [-1.0, 1.0, 1.0], m[:3, :3] @ poses[:, :3, :3] @ m[:3, :3]
    return told(r, place, turn, x_mm=-r.x_mm, flange_from_profiler=m @ r.flange_from_profiler @ m)


def backwards(r: Recording) -> Recording:
    """The scan run the other way: frames and passes in the opposite order."""
    poses, last = flange_poses(r)[::-1], r.time_s[-1] + r.time_s[0]
    turned = frames(r, np.arange(len(r.time_s))[::-1])
    turned = with_values(turned, time_s=last - turned.time_s, pass_index=r.pass_index.max() - turned.pass_index)
    return told(turned, poses[:, :3, 3], poses[:, :3, :3])


def write_tables(path: Path, folder: Path) -> int:
    """A recording's file as what `workbench import` takes: scan.csv, robot.csv, map.json; how many frames it has."""
    import h5py
    import pyarrow as pa
    import pyarrow.csv

    with h5py.File(path) as file, (folder / "scan.csv").open("wb") as table:
        profiles, robot = file["profiles"], file["robot"]
        frames, columns = profiles["x"].shape
        table.write(b"frame,time_s,x_mm,z_mm\n")
        for first in range(0, frames, BLOCK):
            some = slice(first, min(first + BLOCK, frames))
            number, at = np.arange(some.start, some.stop), np.round(profiles["time"][some], 6)
            rows = {"frame": number.repeat(columns), "time_s": at.repeat(columns)}
            rows |= {f"{axis}_mm": np.round(profiles[axis][some].ravel().astype(float), 4) for axis in "xz"}
            known = np.isfinite(rows["z_mm"])
            block = pa.table({key: values[known] for key, values in rows.items()})
            pyarrow.csv.write_csv(block, table, pyarrow.csv.WriteOptions(include_header=False))
        poses = np.column_stack([robot[key][()] for key in ("time", "position", "quaternion_wxyz")])
        hand_eye = file["hand_eye/flange_from_profiler"][()].tolist()
    head = "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz"
    np.savetxt(folder / "robot.csv", poses, "%.9f", ",", header=head, comments="")
    mapping = {"format": "import-mapping", "version": 1, "hand_eye": {"flange_from_profiler": hand_eye}}
    (folder / "map.json").write_text(json.dumps(mapping))
    return int(frames)
