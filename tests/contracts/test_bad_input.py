"""Whatever is thrown at the command, it ends with 0, 1 or 2, says at most one `error:` line and never a traceback."""

import contextlib
import io
import json
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from workbench.cli import main

PIPELINE = Path(__file__).parents[2] / "pipelines" / "inspect_bevel.json"
DOCUMENT = json.loads(PIPELINE.read_text())
DOCUMENT["stages"] = [entry for entry in DOCUMENT["stages"] if not entry["stage"].startswith("report.")]
quick = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
whole = settings(quick, max_examples=16)  # a run each; `make fuzz` tries thousands

scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just("${recording}")
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
)


def check(*arguments: object) -> tuple[int, str]:
    """Run the command in this process and check how it ends; returns the exit status and the error line."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([str(argument) for argument in arguments])
    lines = [line for line in err.getvalue().splitlines() if not line.startswith(("[", "compiling", "note:"))]
    assert status in (0, 1, 2)
    assert len(lines) == (1 if status == 2 else 0), lines
    assert all(line.startswith("error: ") and "internal" not in line for line in lines), lines
    return status, "".join(lines)


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Every (container, key) of a document."""
    keys = list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else []
    return [found for key in keys for found in [(tree, key), *places(tree[key])]]


@st.composite
def mutated_documents(draw: st.DrawFn) -> str:
    """The shipped pipeline with up to three values replaced, removed or renamed, as text."""
    document = json.loads(json.dumps(DOCUMENT))
    for _ in range(draw(st.integers(1, 3))):
        container, key = draw(st.sampled_from(places(document) or [(document, "version")]))
        action = draw(st.sampled_from(["replace", "remove", "rename", "repeat"]))
        value = container.pop(key, None) if isinstance(container, dict) else container.pop(key)
        if isinstance(container, dict):
            if action != "remove":
                container[draw(st.text(max_size=8)) if action == "rename" else key] = (
                    draw(values) if action == "replace" else value
                )
        elif action != "remove":
            container[key:key] = [draw(values)] if action == "replace" else [value] * draw(st.integers(1, 3))
    return json.dumps(document)


@quick
@given(text=mutated_documents())
def test_mutated_pipelines(recording_file: Path, text: str) -> None:
    with tempfile.TemporaryDirectory() as place:
        path = Path(place, "p.json")
        path.write_text(text)
        check("validate", path, "--input", f"recording={recording_file}")


@quick
@given(cut=st.integers(0, 2000), noise=st.binary(max_size=6))
def test_mutated_text(recording_file: Path, cut: int, noise: bytes) -> None:
    content = PIPELINE.read_bytes()
    with tempfile.TemporaryDirectory() as place:
        path = Path(place, "p.json")
        path.write_bytes(content[:cut] + noise + content[cut + len(noise) :])
        check("validate", path, "--input", f"recording={recording_file}")


@quick
@given(
    arguments=st.lists(
        st.sampled_from(["run", "validate", "stages", "--input", "--set", "--out", "a=1", "x.y=2", "-x", "="])
        | st.text(max_size=5),
        max_size=5,
    )
)
def test_mutated_arguments(arguments: list[str]) -> None:
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        check(*arguments)


Change = Callable[[h5py.File, Any], None]


def _rewrite(file: h5py.File, name: str, value: Any) -> None:
    attributes = dict(file[name].attrs)
    del file[name]
    file[name] = value
    file[name].attrs.update(attributes)


def _poke(file: h5py.File, draw: Any) -> None:
    name = draw(st.sampled_from(DATA_SETS))
    value = draw(st.sampled_from([np.nan, np.inf, -3e38, 0.0, 1e9]))
    array = file[name][()]
    array.reshape(-1)[draw(st.integers(0, array.size - 1)) :: draw(st.integers(1, 5))] = value
    file[name][...] = array


DATA_SETS = ["/profiles/time", "/profiles/x", "/profiles/z", "/robot/time", "/robot/position", "/robot/quaternion_wxyz"]
DATA_SETS += ["/hand_eye/flange_from_profiler"]
RESHAPES: list[Callable[[np.ndarray], Any]] = [
    lambda array: array[:1],
    lambda array: array[: len(array) // 2],
    lambda array: array[::-1],
    lambda array: array[..., None],
    lambda array: array.astype("S8"),
    lambda array: array.astype(complex),
    lambda array: np.nan_to_num(array).astype(np.int64),
    lambda array: np.zeros_like(array),
    lambda array: np.empty((0, *array.shape[1:])),
    lambda array: 3.0,
    lambda array: array * 1000,
]


def _reshape(file: h5py.File, draw: Any) -> None:
    name = draw(st.sampled_from(DATA_SETS))
    _rewrite(file, name, draw(st.sampled_from(RESHAPES))(file[name][()]))


def _remove(file: h5py.File, draw: Any) -> None:
    del file[draw(st.sampled_from([*DATA_SETS, "/profiles", "/robot", "/hand_eye"]))]


def _attribute(file: h5py.File, draw: Any) -> None:
    value = draw(st.sampled_from(["m", "", 2, -1, 1.5, np.array([1, 2]), b"\xff", "own", h5py.Empty("f")]))
    place = file[draw(st.sampled_from(["/", "/profiles"]))]
    place.attrs[draw(st.sampled_from(["format", "version", "length_unit", "time_unit", "clock", "part_id"]))] = value


@whole
@given(data=st.data(), change=st.sampled_from([_poke, _reshape, _remove, _attribute]))
def test_mutated_recordings(recording_file: Path, data: st.DataObject, change: Change) -> None:
    with tempfile.TemporaryDirectory() as place:
        path, pipeline = Path(place, "part.h5"), Path(place, "p.json")
        shutil.copy(recording_file, path)
        pipeline.write_text(json.dumps(DOCUMENT))
        with h5py.File(path, "r+") as file:
            change(file, data.draw)
        status, _ = check("run", pipeline, "--input", f"recording={path}", "--out", Path(place, "out"))
        assert Path(place, "out").exists() == (status != 2)


@whole
@given(at=st.integers(0, 4000), length=st.integers(1, 40), seed=st.integers(0, 99), cut=st.booleans())
def test_damaged_recordings(recording_file: Path, at: int, length: int, seed: int, cut: bool) -> None:
    """Bytes overwritten in the headers, or the file cut off."""
    content = bytearray(recording_file.read_bytes())
    content[at : at + length] = np.random.default_rng(seed).bytes(length)
    with tempfile.TemporaryDirectory() as place:
        path, pipeline = Path(place, "part.h5"), Path(place, "p.json")
        path.write_bytes(content[: at * len(content) // 4000] if cut else content)
        pipeline.write_text(json.dumps(DOCUMENT))
        check("run", pipeline, "--input", f"recording={path}", "--out", Path(place, "out"))


def test_check_can_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests above rest on it."""
    monkeypatch.setattr("workbench.pipeline.run.plan", lambda *_: 1 / 0)
    with pytest.raises(AssertionError, match="internal"):
        check("validate", PIPELINE)
