"""The stage cache: the same results, and nothing computed twice that rests on nothing new."""

import itertools
import json
import shutil
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from workbench import Pipeline
from workbench.artefacts import HandEye, PathGate, Toolpath
from workbench.errors import OutputError
from workbench.pipeline import cache as module
from workbench.stage import stage

ROOT = Path(__file__).parents[2]
RECORDING = str(ROOT / "data" / "synthetic" / "milled_edge.h5")


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each stage was really run."""
    from workbench.pipeline import run

    counts: Counter[str] = Counter()
    inner = run._run_step

    def counted(step: Any, *rest: Any) -> Any:
        counts[step.stage.name] += 1
        return inner(step, *rest)

    monkeypatch.setattr(run, "_run_step", counted)
    monkeypatch.setattr(module, "QUICK_S", 0.0)
    return counts


def inspect(out: Path | None, cache: Path | None, **inputs: Any) -> dict[str, bytes]:
    pipeline = Pipeline.load(ROOT / "pipelines" / "inspect_bevel.json")
    given = {"recording": RECORDING, **inputs}
    results = pipeline.run(out, inputs=given, cache=cache, report=False)
    files = {path.name: path.read_bytes() for path in results.files}
    run = json.loads(files.pop("run.json", b"{}"))
    for entry in run.get("stages", []):
        del entry["seconds"]
    return files | {"run": json.dumps(run).encode()}


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    """A run's cache and its results."""
    folder = tmp_path_factory.mktemp("first")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "QUICK_S", 0.0)
        return folder / "cache", inspect(folder / "out", folder / "cache")


@pytest.fixture
def cache(first: tuple[Path, Any], tmp_path: Path) -> Path:
    return Path(shutil.copytree(first[0], tmp_path / "cache"))


def test_the_same_bytes_and_only_what_reads_files_is_run_again(first, cache, tmp_path, ran):
    plain = inspect(tmp_path / "plain", None)
    ran.clear()
    assert inspect(tmp_path / "second", cache) == first[1] == plain
    assert set(ran) == {"scan.read", "export.qif"}  # which states the run's provenance


def test_a_changed_tolerance_does_not_segment_again(cache: Path, tmp_path: Path, ran: Counter[str]) -> None:
    changed = inspect(tmp_path / "b", cache, root_tolerance_mm=[-0.01, 0.01])
    assert json.loads(changed["inspection.json"])["verdict"] == "fail"
    assert "edge.segment" not in ran
    assert ran["inspect.sections"] == 1
    assert changed == inspect(tmp_path / "c", None, root_tolerance_mm=[-0.01, 0.01])


HARMS = (lambda b: b[:50], lambda b: b"", lambda b: b[:-3] + b"xyz", lambda b: b"x" * 200)


def test_damaged_entries_are_made_anew(first: tuple[Path, Any], cache: Path, tmp_path: Path, ran: Counter[str]) -> None:
    entries = sorted(cache.glob("*.stage"))
    assert len(entries) >= len(HARMS)
    for entry, harm in zip(entries, itertools.cycle(HARMS), strict=False):
        entry.write_bytes(harm(entry.read_bytes()))
    for again, runs in (("b", 1), ("c", 0)):
        ran.clear()
        assert inspect(tmp_path / again, cache) == first[1]
        assert set(ran.values()) == {1}
        assert ran["edge.segment"] == runs


def test_changed_code_is_run(cache: Path, ran: Counter[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "package_digest", lambda name: "other")
    inspect(None, cache)
    assert ran["edge.segment"] == 1


def test_another_recording_under_the_same_name_is_measured(tmp_path: Path, ran: Counter[str]) -> None:
    part, found = tmp_path / "part.h5", []
    for name in ("milled_edge", "milled_edge_again"):
        part.write_bytes((ROOT / "data" / "synthetic" / f"{name}.h5").read_bytes())
        found.append(inspect(tmp_path / name, tmp_path / "cache", recording=str(part))["inspection.json"])
    assert found[0] != found[1]


def test_what_only_this_process_knows_is_made_again(demo_document: Any, tmp_path: Path, ran: Counter[str]) -> None:
    @stage("demo.local")
    def local(pose: HandEye) -> HandEye:
        """Hand on a pose that holds a function."""
        return HandEye(pose.flange_from_profiler, source=lambda: pose)  # type: ignore[arg-type]

    demo_document["stages"].insert(1, {"stage": "demo.local"})
    for _ in range(2):
        Pipeline(demo_document, base_dir=tmp_path).run(cache=tmp_path / "cache")
    assert (ran["demo.local"], ran["demo.inspect"]) == (2, 1)


def test_a_decision_out_of_the_cache_is_of_the_path_beside_it(tmp_path: Path, ran: Counter[str]) -> None:
    """As the programs of a second controller ask, planned with the same cache."""
    pipeline = Pipeline.load(ROOT / "pipelines" / "plan_bevel.json")
    given = {"recording": str(ROOT / "data" / "synthetic" / "raw_arc.h5")}
    for _ in range(2):
        ran.clear()
        made = pipeline.run(inputs=given, cache=tmp_path / "cache", report=False)
        assert made.last(PathGate).toolpath is made.last(Toolpath)
    assert "path.check" not in ran


def test_a_folder_that_others_may_write_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(0o777)
    with pytest.raises(OutputError, match="you alone may write"):
        inspect(None, tmp_path / "cache")
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be used"):
        inspect(None, tmp_path / "file")
