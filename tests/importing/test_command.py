"""`workbench import` as a user meets it: what is printed, exit status, one error line, nothing half-written."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests.importing import makers
from tests.importing.conftest import profiles_part
from workbench.artefacts import Recording
from workbench.cli import main

AXIS = {"linear_axis": {"direction": [0, 1, 0], "speed_mm_s": 50}}
Mapped = Callable[..., Path]
Out = pytest.CaptureFixture[str]


def test_what_was_understood_is_printed(tmp_path: Path, mapped: Mapped, capsys: Out) -> None:
    source, out = makers.write_scancontrol(tmp_path / "a.csv"), tmp_path / "a.h5"
    mapping = mapped(**AXIS, part_id="A-7", robot="none")
    assert main(["import", str(source), "--out", str(out), "--mapping", str(mapping)]) == 0
    printed, errors = capsys.readouterr()
    assert errors == ""
    lines = printed.splitlines()
    assert lines[0] == f"{source}: scanCONTROL profiles: blocks of x, y, z rows in mm; y is the way along the scan"
    assert lines[1] == f"{source}: frames of 37 to 40 points: columns by the gaps in x"
    assert "profiles: 6 frames of 40 columns, pitch 0.25 mm, 3.3 % missing" in lines  # 8 of 240
    assert "returns: x -5 to 4.75 mm, z 79.95 to 83.3 mm" in lines
    assert "pass 0: 6 frames over 0.05 s, 6 poses, travel 2.5 mm" in lines
    assert lines[-1] == f"recording: {out}"
    with h5py.File(out) as file:
        assert dict(file.attrs)["sensor"] == "scanCONTROL"
        assert dict(file.attrs)["robot"] == "none"
        assert dict(file.attrs)["part_id"] == "A-7"


def test_known_headers_need_no_mapping(tmp_path: Path, milled: Recording, capsys: Out) -> None:
    rows = [
        f"{frame},{time!r},{x!r},{z!r}"
        for frame, time in enumerate(milled.time_s[::30].tolist())
        for x, z in zip(milled.x_mm[30 * frame].tolist(), milled.z_mm[30 * frame].tolist(), strict=True)
    ]
    (tmp_path / "scan.csv").write_text("frame,time_s,x_mm,z_mm\n" + "\n".join(rows))
    poses = np.column_stack([milled.robot_time_s, milled.robot_position_mm, milled.robot_quaternion_wxyz])
    for names in ("qw,qx,qy,qz", "q1,q2,q3,q4"):
        text = "\n".join(",".join(map(repr, row)) for row in poses.tolist())
        (tmp_path / "robot.csv").write_text(f"time_s,x_mm,y_mm,z_mm,{names}\n{text}")
        sources = [str(tmp_path / name) for name in ("scan.csv", "robot.csv")]
        assert main(["import", *sources, "--out", str(tmp_path / "a.h5")]) == 0
        assert "hand-eye: none: a pipeline must name one" in capsys.readouterr().out
        with h5py.File(tmp_path / "a.h5") as file:
            np.testing.assert_array_equal(file["profiles/z"], milled.z_mm[::30])


REFUSED = {
    "no such file": (["nothing.csv"], "nothing.csv: no such file"),
    "a name without its ending": (["b"], "b: no such file; known: b.csv"),
    "a directory": (["."], ".: expected a file"),
    "not a recording's name": (["a.csv", "--out", "b.txt"], "b.txt: expected the name of a recording"),
    "no such mapping": (["a.csv", "--mapping", "nothing.json"], "nothing.json: no such file"),
    "a source twice": (["a.csv", "./a.csv"], "./a.csv: occurs twice among the sources"),
    "no poses": (["b.csv"], "b.csv: expected poses too: a file of poses, or linear_axis in the mapping"),
    "two sources wrong": (["a.h5x", "c.csv"], "sources: (1) a.h5x: no such file"),
    "no such folder": (["a.csv", "--mapping", "map.json", "--out", "none/a.h5"], "none/a.h5: cannot be written"),
    "an unknown option": (["a.csv", "--maping", "map.json"], "unknown option '--maping'; did you mean '--mapping'"),
}


@pytest.mark.parametrize("way", ["look", "import --out a.h5", "import --draft --out map.json"])
@pytest.mark.parametrize("name", ["run.bag", "run.db3", "run.MCAP", "folder"])
def test_of_a_bag_it_is_said_how_it_becomes_tables(way: str, name: str, tmp_path: Path, capsys: Out) -> None:
    (tmp_path / "folder").mkdir()
    for file in ("folder/metadata.yaml", name) if name != "folder" else ("folder/metadata.yaml",):
        (tmp_path / file).write_bytes(b"#ROSBAG")
    assert main([*way.replace("--out ", f"--out {tmp_path}/").split(), str(tmp_path / name)]) == 2
    said = "make tables of its profiles and poses (docs/importing.md#other-forms)\n"
    printed, errors = capsys.readouterr()
    assert (printed, errors.count("\n"), errors[-len(said) :]) == ("", 1, said)
    assert not [*tmp_path.glob("*.h5"), *tmp_path.glob("*.json")]


@pytest.mark.parametrize("case", REFUSED)
def test_one_line_and_nothing_written(
    case: str, tmp_path: Path, mapped: Mapped, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments, message = REFUSED[case]
    monkeypatch.chdir(tmp_path)
    makers.write_scancontrol(tmp_path / "a.csv")
    makers.write_gopxl(tmp_path / "b.csv")
    mapped(**AXIS)
    before = sorted(os.listdir(tmp_path))
    if "--out" not in arguments:
        arguments = [*arguments, "--out", "out.h5"]
    assert main(["import", *arguments]) == 2
    printed, errors = capsys.readouterr()
    assert printed == ""
    assert errors.startswith("error: ")
    assert errors.count("\n") == 1
    assert message in errors
    assert sorted(os.listdir(tmp_path)) == before


def test_a_pattern_that_names_no_source_is_told(tmp_path: Path, mapped: Mapped, capsys: Out) -> None:
    table, mapping = tmp_path / "x.csv", mapped(profiles=profiles_part())
    table.write_text("a,b\n1,2\n3,4\n5,6\n")
    arguments = ["import", str(table), "--out", str(tmp_path / "a.h5")]
    assert main([*arguments, "--mapping", str(mapping)]) == 2
    assert "x.csv: is in no known form (docs/importing.md); by its name it is none" in (told := capsys.readouterr().err)
    assert "'scan*' of profiles" in told
    assert main(arguments) == 2
    assert f"`workbench import --draft {table}` begins a mapping" in capsys.readouterr().err


@pytest.mark.parametrize("draft", [[], ["--draft"]])
def test_a_mapping_is_no_source(draft: list[str], tmp_path: Path, mapped: Mapped, capsys: Out) -> None:
    out = tmp_path / ("a.json" if draft else "a.h5")
    assert main(["import", str(mapped(**AXIS)), *draft, "--out", str(out)]) == 2
    assert "map.json: is a mapping, no source: give it by --mapping" in capsys.readouterr().err


def test_travel_in_the_file_is_used(tmp_path: Path, capsys: Out) -> None:
    out = tmp_path / "a.h5"
    assert main(["import", str(makers.write_gocator(tmp_path / "a.csv")), "--out", str(out)]) == 0
    assert "from travel along (0, 1, 0) of the profiler's frame" in capsys.readouterr().out
    with h5py.File(out) as file:
        np.testing.assert_allclose(file["robot/position"][:, 1], makers.TRAVEL_MM)


def test_an_earlier_recording_stays_where_the_new_one_fails(tmp_path: Path, mapped: Mapped, capsys: Out) -> None:
    (tmp_path / "out.h5").write_bytes(b"earlier")
    source = makers.write_scancontrol(tmp_path / "a.csv")
    source.write_bytes(source.read_bytes()[:-2000])
    arguments = ["import", str(source), "--out", str(tmp_path / "out.h5"), "--mapping", str(mapped(**AXIS))]
    assert main(arguments) == 2
    assert (tmp_path / "out.h5").read_bytes() == b"earlier"


def test_a_device_that_fails_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Out) -> None:
    source = makers.write_gocator(tmp_path / "a.csv")
    plain = open

    def failing(file: Any, *how: Any, **more: Any) -> Any:
        if str(file) == str(source):
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return plain(file, *how, **more)

    monkeypatch.setattr("builtins.open", failing)
    assert main(["import", str(source), "--out", str(tmp_path / "a.h5")]) == 2
    assert capsys.readouterr().err == f"error: {source}: cannot be read: Input/output error\n"


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.csv")
    command = [sys.executable, "-m", "workbench", "import", str(tmp_path / "a.csv"), "--out", str(tmp_path / "a.h5")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
