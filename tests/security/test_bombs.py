"""Small files that would grow without end, or lead out of themselves: one line, little work, nothing written."""

import json
import os
import resource
import zlib

import h5py
import numpy as np
import pytest

from tests.security.conftest import ROOT
from tests.security.hostile import assert_refused
from tests.work import calls_of

READ = ({"stage": "scan.read", "recording": "${file}"},)
MOST_CALLS, MEMORY_KB = 1_000_000, 400_000


@pytest.fixture
def refused(pipeline_file, command, tmp_path):
    """`refused(stages, file, place)`: the run ends in one line that names the place, and leaves nothing."""

    def run(stages, file, place=""):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        run = ("run", pipeline_file(*stages, file=str(file)), "--out", tmp_path / "out")
        calls, outcome = calls_of(lambda: command(*run))
        assert_refused(outcome, place)
        assert calls < MOST_CALLS
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MEMORY_KB
        assert not (tmp_path / "out").exists()
        return outcome

    return run


JSON = {"arrays": b"[" * 100_000 + b"]" * 100_000, "zero bytes": bytes(1000)}
READERS = {
    "toolpath": ({"stage": "path.read", "toolpath": "${file}"},),
    "cell": ({"stage": "robot.cell", "cell": "${file}"},),
    "stiffness": ({"stage": "stiffness.read", "stiffness": "${file}"},),
    "recipe": ({"stage": "twin.part", "recipe": "${file}"},),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("content", JSON.values(), ids=JSON)
def test_json(reader, content, refused, tmp_path):
    """tests/pipeline/test_document.py has them all: one parser reads every file."""
    (tmp_path / "file.json").write_bytes(content)
    refused(READERS[reader], tmp_path / "file.json", "file.json")


LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10 if i else "ha" * 100}">' for i in range(12))
URDF = {
    "entities": f'<!DOCTYPE robot [{LAUGHS}]><robot name="&l11;"/>',
    "one long entity": f'<!DOCTYPE robot [<!ENTITY a "{"a" * 100_000}">]><robot name="{"&a;" * 100_000}"/>',
    "another file": '<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="x">&a;</robot>',
    "a file of parameters": '<!DOCTYPE robot [<!ENTITY % a SYSTEM "file:///etc/passwd"> %a;]><robot name="x"/>',
    "a schema elsewhere": '<!DOCTYPE robot SYSTEM "http://127.0.0.1:9/x.dtd"><robot name="x"/>',
    "deep": '<robot name="x">' + "<link>" * 50_000 + "</link>" * 50_000 + "</robot>",
    "no robot": "<html/>",
    "many attributes": '<robot name="x"><link ' + " ".join(f'a{i}="x"' for i in range(20_000)) + "/></robot>",
}


@pytest.mark.parametrize("content", URDF.values(), ids=URDF)
def test_urdf(content, refused, tmp_path):
    cell = json.loads((ROOT / "data/robot/cell.json").read_text())
    cell["robot"]["urdf"] = "robot.urdf"
    (tmp_path / "cell.json").write_text(json.dumps(cell))
    (tmp_path / "robot.urdf").write_text(content)
    outcome = refused(READERS["cell"], tmp_path / "cell.json", "robot.urdf")
    assert "root:" not in outcome.err


@pytest.mark.parametrize(
    "named", ["/dev/zero", "/dev/stdin", "..", "/proc/self/mem", "pipe", "missing.urdf", "a\x00b", ""]
)
def test_files_that_a_cell_names_are_files(named, refused, tmp_path):
    """A device or a pipe would be read for ever."""
    os.mkfifo(tmp_path / "pipe")
    cell = json.loads((ROOT / "data/robot/cell.json").read_text())
    (tmp_path / "cell.json").write_text(json.dumps({**cell, "robot": {**cell["robot"], "urdf": named}}))
    refused(READERS["cell"], tmp_path / "cell.json")
    shipped = str(ROOT / "data/robot" / cell["robot"]["urdf"])
    changed = {**cell, "robot": {**cell["robot"], "urdf": shipped}, "workpiece": {"mesh": named or "x"}}
    (tmp_path / "cell.json").write_text(json.dumps(changed))
    refused(READERS["cell"], tmp_path / "cell.json")


def packed_bomb(file, path):
    """A gigabyte of zeros in a megabyte of gzip."""
    del file[path]
    file.create_dataset(path, (2**18, 2**10), "f4", chunks=(2**12, 2**10), compression="gzip", compression_opts=9)
    raw = np.zeros((2**12, 2**10), "f4").tobytes()
    packed = zlib.compress(raw, 9)
    for row in range(0, 2**18, 2**12):
        file[path].id.write_direct_chunk((row, 0), packed)


def chunk_of_another_size(file, path):
    shape = file[path].shape
    del file[path]
    file.create_dataset(path, shape, "f4", chunks=shape, compression="gzip")
    file[path].id.write_direct_chunk((0,) * len(shape), zlib.compress(bytes(2**27), 9))


def an_object_reference(file, path):
    del file[path]
    file.create_dataset(path, (3,), h5py.ref_dtype)


def a_python_pickle(file, path):
    """What PyTables stores for objects: a text of bytes that it would unpickle."""
    del file[path]
    file[path] = np.void(b"cos\nsystem\n(S'touch owned'\ntR.")


HDF5 = [packed_bomb, chunk_of_another_size, an_object_reference, a_python_pickle]  # links: tests/scan/test_read.py


@pytest.mark.parametrize("damage", HDF5, ids=lambda f: f.__name__)
@pytest.mark.parametrize("path", ["/profiles/x", "/profiles/time"])
def test_hdf5(damage, path, refused, part_file, tmp_path):
    file = tmp_path / "part.h5"
    file.write_bytes(part_file.read_bytes())
    with h5py.File(file, "r+") as opened:
        damage(opened, path)
    outcome = refused(READ, file, "part.h5")
    assert "root:" not in outcome.err


@pytest.mark.parametrize("value", [1e300, 1e12])
@pytest.mark.parametrize("path", ["/robot/position", "/profiles/x", "/profiles/time", "/robot/time"])
def test_numbers_that_no_part_has(value, path, pipeline_file, command, part_file, tmp_path):
    """Refused in a line, or carried to a verdict; never a traceback, and never a NaN in a result."""
    file = tmp_path / "part.h5"
    file.write_bytes(part_file.read_bytes())
    with h5py.File(file, "r+") as opened, np.errstate(over="ignore"):
        values = opened[path][...]
        values.reshape(-1)[values.size // 2] = value
        opened[path][...] = values
    stages = [
        *READ,
        {"stage": "scan.fuse"},
        {"stage": "cloud.denoise"},
        {"stage": "edge.segment"},
        {"stage": "inspect.sections"},
    ]
    outcome = command("run", pipeline_file(*stages, file=str(file)), "--out", tmp_path / "out")
    if outcome.status:
        assert_refused(outcome, "part.h5")
        return
    text = (tmp_path / "out/inspection.json").read_text()
    json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in a result"))
