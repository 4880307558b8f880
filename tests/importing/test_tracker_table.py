"""Readings of a laser tracker and the robot's postures: joined by number, by time or in order, by a mapping."""

from __future__ import annotations

import json
import random
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.fuzz.mutate import mutated
from workbench.api import pose_from, quaternion_from_rotation, rotation_from_vector
from workbench.cli import main
from workbench.errors import InputError
from workbench.importing.command import import_files
from workbench.importing.draft import drafted as drafted_mapping
from workbench.plugins import calibration

RNG = np.random.default_rng(4)
COUNT = 12
MUTATIONS = 20
TABLE = {"files": "l.csv", "targets": [["X [mm]", "Y [mm]", "Z [mm]"]]}
JOINTS_DEG = RNG.uniform(-60.0, 60.0, (COUNT, 6))
PLACES_MM = RNG.uniform(-2000.0, 2000.0, (COUNT, 3))


def joints_file(path: Path, first: str = "", firsts: Any = None, joints_deg: Any = JOINTS_DEG) -> Path:
    names = ",".join(f"q{k}_deg" for k in range(1, 7))
    columns = joints_deg if firsts is None else np.column_stack([firsts, joints_deg])
    np.savetxt(path, columns, delimiter=",", header=f"{first},{names}" if first else names, comments="", fmt="%.9g")
    return path


def positions_file(path: Path, numbers: Any) -> Path:
    """Two readings of each position, 0.02 mm apart."""
    lines = []
    for number in numbers:
        lines.append(f"Pos {number}")
        for off in (-0.01, 0.01):
            x, y, z = PLACES_MM[number - 1] + off
            lines.append(f"Cnt=1  X={x:.4f} Y={y:.4f} Z={z:.4f} RotX=    1.530")
    path.write_text("\n".join(lines) + "\n")
    return path


def places_file(path: Path, places: Any, times: Any = None) -> Path:
    """A row a position: name, x, y, z, and the clock in s."""
    rows = ["Name,X [mm],Y [mm],Z [mm],U95 [mm]" + (",Time" if times is not None else "")]
    for k, (x, y, z) in enumerate(places):
        rows.append(f"P{k},{x:.4f},{y:.4f},{z:.4f},0.03" + (f",{times[k]}" if times is not None else ""))
    path.write_text("\n".join(rows) + "\n")
    return path


def table(tmp_path: Path, capsys: Any, *sources: Path, **parts: Any) -> tuple[list[str], list[list[float]], str]:
    """Targets, numbers and what was told, of what a drafted and confirmed mapping makes."""
    draft, out = tmp_path / "map.json", tmp_path / "readings.csv"
    unnamed = [str(source) for source in sources if source.name != TABLE["files"]]  # what a draft can tell
    assert main(["import", "--draft", *unnamed, "--out", str(draft)]) == 0
    tree = {**json.loads(draft.read_text()), **parts, "uncertain": []}
    draft.write_text(json.dumps(tree))
    status = main(["import", *map(str, sources), "--mapping", str(draft), "--out", str(out)])
    told = capsys.readouterr()
    if status:
        return [], [], told.err
    header, *rows = [line.split(",") for line in out.read_text().splitlines()]
    assert header[0] == "target"
    assert header[-3:] == ["tracker_x_mm", "tracker_y_mm", "tracker_z_mm"]
    return [row[0] for row in rows], [[float(value) for value in row[1:]] for row in rows], told.out


def test_a_position_is_the_posture_of_its_number(tmp_path: Path, capsys: Any) -> None:
    shuffled = RNG.permutation(COUNT)
    sources = [
        positions_file(tmp_path / "t.txt", range(1, COUNT)),
        joints_file(tmp_path / "q.csv", "posture", shuffled + 1, JOINTS_DEG[shuffled]),
    ]
    targets, rows, told = table(tmp_path, capsys, *sources)
    assert set(targets) == {"target"}
    np.testing.assert_allclose(rows, np.column_stack([JOINTS_DEG, PLACES_MM])[:-1], atol=1e-4)
    assert f"joined by number: {COUNT - 1} rows of {2 * COUNT - 2} readings" in told
    assert f"postures without a reading: {COUNT}" in told
    sources[0] = positions_file(tmp_path / "t.txt", [1, 2])
    joints_file(tmp_path / "q.csv", "posture", [1, 3], JOINTS_DEG[:2])
    assert "position 2:" in table(tmp_path, capsys, *sources)[2]


def test_by_time_only_while_the_robot_stands(tmp_path: Path, capsys: Any) -> None:
    """A log of 10 a second that stands 4 s in each posture and moves for 2 s; the tracker's clock is 100 s ahead."""
    time_s = np.arange(0.0, 6.0 * COUNT, 0.1)
    knots = np.ravel([[6.0 * k, 6.0 * k + 4.0] for k in range(COUNT)])
    log = np.stack([np.interp(time_s, knots, np.repeat(column, 2)) for column in JOINTS_DEG.T], axis=1)
    joints = joints_file(tmp_path / "q.csv", "time_s", time_s, log)
    seen_s = [*(6.0 * np.arange(COUNT) + 2.0), 5.0, 1000.0]  # in each posture; on the way; long after
    places = [*PLACES_MM, [0.0] * 3, [0.0] * 3]
    offset = 1774951200.0 + 100.0
    sources = [places_file(tmp_path / "l.csv", places, np.array(seen_s) + offset), joints]
    part = {**TABLE, "time": "Time", "time_unit": "s", "pair": "time"}
    assert "goes with a posture" in table(tmp_path, capsys, *sources, tracker=part)[2]  # as of another day
    times = {"source": "file", "clock_offset_s": offset}
    targets, rows, told = table(tmp_path, capsys, *sources, times=times, tracker=part)
    assert targets == ["t1"] * COUNT
    np.testing.assert_allclose(rows, np.column_stack([JOINTS_DEG, PLACES_MM]), atol=1e-3)
    assert "left out: 1 readings without a posture within 0.5 s" in told
    assert "left out: 1 readings while the robot moved" in told


@pytest.mark.parametrize("pair", ["number", "order"])
def test_a_row_a_posture(pair: str, tmp_path: Path, capsys: Any) -> None:
    """By number readings may lack at the end, and it is told; in order as many are expected."""
    sources, part = (
        [places_file(tmp_path / "l.csv", PLACES_MM), joints_file(tmp_path / "q.csv")],
        {**TABLE, "pair": pair},
    )
    _, rows, _ = table(tmp_path, capsys, *sources, tracker=part)
    np.testing.assert_allclose(rows, np.column_stack([JOINTS_DEG, PLACES_MM]), atol=1e-4)
    places_file(tmp_path / "l.csv", PLACES_MM[:-1])
    told = {"number": f"without a reading: {COUNT}", "order": f"{COUNT - 1} readings of 't1' and {COUNT} postures"}
    assert told[pair] in table(tmp_path, capsys, *sources, tracker=part)[2]


def test_places_and_joints_in_one_table(tmp_path: Path, capsys: Any) -> None:
    both = np.column_stack([PLACES_MM, PLACES_MM[::-1], np.zeros(COUNT), JOINTS_DEG])
    np.savetxt(tmp_path / "both.txt", both)
    targets, rows, _ = table(tmp_path, capsys, tmp_path / "both.txt")
    assert targets == ["t1", "t2"] * COUNT
    places = np.stack([PLACES_MM, PLACES_MM[::-1]], axis=1).reshape(-1, 3)
    np.testing.assert_allclose(rows, np.column_stack([np.repeat(JOINTS_DEG, 2, axis=0), places]), rtol=1e-8)


def test_what_is_not_confirmed_or_lacking_makes_no_table(tmp_path: Path, capsys: Any) -> None:
    tracker, joints = positions_file(tmp_path / "t.txt", range(1, COUNT + 1)), tmp_path / "q.csv"
    np.savetxt(joints, np.column_stack([np.arange(1, COUNT + 1), np.radians(JOINTS_DEG)]), delimiter=",")
    assert main(["import", "--draft", str(tracker), "--out", str(tmp_path / "m.json")]) == 0
    assert "lacking: with this mapping" in capsys.readouterr().out
    assert main(["import", "--draft", str(tracker), str(joints), "--out", str(tmp_path / "m.json")]) == 0
    arguments = [str(tracker), str(joints), "--mapping", str(tmp_path / "m.json"), "--out"]
    assert main(["import", *arguments, str(tmp_path / "r.csv")]) == 2
    assert "is not confirmed" in capsys.readouterr().err
    assert main(["import", *arguments, str(tmp_path / "r.h5")]) == 2
    assert "calibrate.tracker" in capsys.readouterr().err
    assert not (tmp_path / "r.csv").exists()


def test_the_table_registers_a_robot(tmp_path: Path, capsys: Any) -> None:
    """The tracker's frame and the target come back from poses and positions."""
    vectors, position = RNG.uniform(-1.0, 1.0, (COUNT, 3)), RNG.uniform(500.0, 1500.0, (COUNT, 3))
    pose = pose_from(np.stack([rotation_from_vector(one) for one in vectors]), position)
    tracker_from_base = pose_from(rotation_from_vector(np.array([0.1, -0.2, 2.0])), np.array([3000.0, -500.0, 200.0]))
    target = np.array([40.0, 30.0, 120.0, 1.0])
    seen = (tracker_from_base @ pose @ target)[:, :3] + RNG.normal(0.0, 0.01, (COUNT, 3))
    q = quaternion_from_rotation(pose[:, :3, :3])
    head = "x_mm,y_mm,z_mm,qw,qx,qy,qz"
    np.savetxt(tmp_path / "p.csv", np.column_stack([position, q]), delimiter=",", header=head, comments="")
    sources = [places_file(tmp_path / "l.csv", seen), tmp_path / "p.csv"]
    assert len(table(tmp_path, capsys, *sources, tracker=TABLE)[0]) == COUNT
    document, _ = calibration.tracker(readings=tmp_path / "readings.csv")
    found = json.loads(document.content)
    np.testing.assert_allclose(found["targets"][0]["position_mm"], target[:3], atol=0.2)
    np.testing.assert_allclose(found["tracker_from_base"], tracker_from_base, atol=0.2)


@pytest.mark.parametrize("which", [0, 1, 2])
def test_damaged_files_are_joined_or_refused(which: int, tmp_path: Path) -> None:
    """Damage ends in a table, or in one line, and leaves nothing half-written; a draft of it likewise."""
    trackers = [positions_file(tmp_path / "a.txt", range(1, COUNT + 1)), places_file(tmp_path / "l.csv", PLACES_MM)]
    robot = joints_file(tmp_path / "q.csv", "posture", np.arange(COUNT) + 1)
    sources = [trackers[which % 2], robot]
    damaged, out = sources[which // 2], tmp_path / "r.csv"
    mapping = tmp_path / "m.json"
    part = {
        "columns": [f"q{k}_deg" for k in range(1, 7)],
        "angle_unit": "deg",
        "length_unit": "mm",
        "number": "posture",
    }
    parts = {"joints": part, "tracker": TABLE} if which % 2 else {"joints": part}
    mapping.write_text(json.dumps({"format": "import-mapping", "version": 1, **parts}))
    rng, content = random.Random(which), damaged.read_bytes()
    import_files(sources, out, mapping)
    assert len(out.read_text().splitlines()) == COUNT + 1
    for _ in range(MUTATIONS):
        damaged.write_bytes(mutated(content, damaged.suffix, rng))
        out.unlink(missing_ok=True)
        lines = [refusal(import_files, sources, out, mapping), refusal(drafted_mapping, sources)]
        assert all(line.isprintable() for line in lines)
        assert [path.name for path in tmp_path.glob("*r.csv*")] == ([] if lines[0] else ["r.csv"])


def refusal(function: Callable[..., object], *arguments: object) -> str:
    """What an InputError says; '' where there was none. Any other error, or warning, is the test's."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            function(*arguments)
        except InputError as error:
            return str(error)
    return ""
