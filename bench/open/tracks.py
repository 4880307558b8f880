"""The recordings of the benchmark: which simulator draws which part, by a set's key.

Of a track's 60 recordings 20 are for practice, their key and truth open to all; 40 are blind: `rounds.json` has the
SHA-256 digest of their key, and the key itself once the round is opened. A key draws the same recordings everywhere.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.score.parts import GROUPS, Part, kept, part
from workbench.scan import read

ROUNDS = Path(__file__).with_name("rounds.json")
SETS = {"practice": 20, "blind": 40}
FORMATS = ("h5", "npz", "csv")
TRACKS = {  # simulators that share no code, in turn
    "milled": ("analytic", "outside", "triangulated", "swept"),
    "raw": ("analytic", "outside", "triangulated", "swept"),
    "groove": ("analytic", "triangulated", "swept"),
    "hand_eye": ("analytic", "rays", "sections"),
}
ODD_EVERY = 7  # a milled part in seven is odd, as in a shop
SEEDS = 10**12


class Entry(NamedTuple):
    """A recording of a set."""

    name: str
    group: str  # of bench.score: what is declared
    simulator: str
    seed: int


def entries(track: str, chosen: str, key: str) -> list[Entry]:
    """The recordings of a set. Milled: declared sharp, worn or undeclared in turn, one in seven odd."""
    simulators, made = TRACKS[track], []
    for number in range(SETS[chosen]):
        simulator = simulators[number % len(simulators)]
        group = track
        if track == "milled":
            ordinary = ("sharp", "worn", "undeclared")[number // len(simulators) % 3]
            group = "odd" if number % ODD_EVERY == ODD_EVERY - 1 else ordinary
            group = "undeclared" if group == "worn" and simulator == "analytic" else group  # it knows no rounding
        word = f"{key} {track} {chosen} {number}"
        seed = int.from_bytes(hashlib.sha256(word.encode()).digest()[:8], "big") % SEEDS
        made.append(Entry(f"{chosen}-{number:02d}", group, simulator, seed))
    return made


def rounds() -> dict[str, Any]:
    """By version, the newest last: `key_sha256`, `key` (null: sealed), `opened`."""
    return dict(json.loads(ROUNDS.read_text(encoding="utf-8")))


def keys(version: str, secret: str | None = None) -> dict[str, str]:
    """Keys of the sets that can be drawn: that of practice is the version; the blind one once it is open or given.

    Raises:
        ValueError: `secret` is not the key whose digest was published.
    """
    known = rounds()[version]
    blind = secret or known["key"]
    if blind and hashlib.sha256(blind.encode()).hexdigest() != known["key_sha256"]:
        raise ValueError(f"this is not the key of round {version}: its digest is another one")
    return {"practice": f"practice {version}"} | ({"blind": blind} if blind else {})


def drawn(entry: Entry, keep: Path | None = None) -> Part:
    """The recording, fetched or drawn; `declared` complete."""
    group = GROUPS[entry.group]
    found = part(entry.simulator, group.recordings, entry.seed, keep or kept())
    return replace(found, declared={**found.declared, **group.declared})


def truth(version: str, track: str, chosen: str, parts: Mapping[str, Part]) -> dict[str, Any]:
    """A truth file's document."""
    head = {"format": "edge-benchmark-truth", "version": 1, "benchmark": version, "track": track, "set": chosen}
    return head | {"recordings": {name: dict(one.truth) for name, one in parts.items()}}


def write(folder: Path, parts: Mapping[str, Part], formats: tuple[str, ...]) -> None:
    """Recordings by the contract (h5), as arrays (npz) and as tables (csv); what is declared of all of them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, one in parts.items():
        if "h5" in formats:
            (folder / f"{name}.h5").write_bytes(one.recording.read_bytes())
        columns = arrays(one.recording)
        if "npz" in formats:
            np.savez_compressed(folder / f"{name}.npz", allow_pickle=False, **columns)
        if "csv" in formats:
            tables(folder / name, columns)
    declared = {name: dict(one.declared) for name, one in parts.items()}
    (folder / "declared.json").write_text(json.dumps(declared, indent=1) + "\n", encoding="utf-8")


def arrays(recording: Path) -> dict[str, Any]:
    """A recording's columns by their names in the contract, `/` as `_`; poses of the robot and the hand-eye pose."""
    r = read(recording=recording)
    found = {
        "profiles_time": r.time_s,
        "profiles_x": r.x_mm,
        "profiles_z": r.z_mm,
        "profiles_pass": r.pass_index,
        "robot_time": r.robot_time_s,
        "robot_position": r.robot_position_mm,
        "robot_quaternion_wxyz": r.robot_quaternion_wxyz,
        "robot_pass": r.robot_pass,
        "hand_eye_flange_from_profiler": r.flange_from_profiler,
        "profiles_intensity": r.intensity,
        "sphere_diameter_mm": r.sphere_diameter_mm,
    }
    return {name: np.asarray(column) for name, column in found.items() if column is not None}


def tables(stem: Path, columns: Mapping[str, Any]) -> None:
    """STEM.profiles.csv: a row a return; STEM.poses.csv: a row a pose, w first; STEM.hand_eye.csv: 4 x 4."""
    x, z = columns["profiles_x"], columns["profiles_z"]
    frame, column = np.nonzero(np.isfinite(x) & np.isfinite(z))
    head = "frame,time_s,pass,column,x_mm,z_mm"
    rows = [
        frame,
        columns["profiles_time"][frame],
        columns["profiles_pass"][frame],
        column,
        x[frame, column],
        z[frame, column],
    ]
    form = ["%d", "%.6f", "%d", "%d", "%.5f", "%.5f"]
    if "profiles_intensity" in columns:
        head, rows, form = f"{head},intensity", [*rows, columns["profiles_intensity"][frame, column]], [*form, "%d"]
    np.savetxt(f"{stem}.profiles.csv", np.column_stack(rows), form, ",", header=head, comments="")
    poses = [columns[f"robot_{name}"] for name in ("time", "pass", "position", "quaternion_wxyz")]
    head = "time_s,pass,x_mm,y_mm,z_mm,qw,qx,qy,qz"
    np.savetxt(f"{stem}.poses.csv", np.column_stack(poses), "%.9g", ",", header=head, comments="")
    np.savetxt(f"{stem}.hand_eye.csv", columns["hand_eye_flange_from_profiler"], "%.12g", ",")
