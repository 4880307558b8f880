"""The output directory: one whole set of results or none, strangers' files untouched, failures clear."""

import contextlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from workbench.errors import OutputError
from workbench.pipeline.output import OLD as OLD_NAME
from workbench.pipeline.output import OutputDirectory, locked

NEW = {"inspection.json": b"new", "run.json": json.dumps({"files": ["inspection.json", "run.json"]}).encode()}
OLD = {
    "toolpath.json": b"old",
    "plate.csv": b"old",
    "run.json": json.dumps({"files": ["toolpath.json", "plate.csv", "../far.txt", 3]}).encode(),
}


def tree(directory: Path) -> dict[str, bytes]:
    return {str(p.relative_to(directory)): p.read_bytes() for p in sorted(directory.rglob("*")) if p.is_file()}


def killed_rename(after: int) -> Callable[[Path, Path], None]:
    """`os.rename` in a process that is killed after so many of them."""
    left, original = iter(range(after)), os.rename

    def rename(a: Path, b: Path) -> None:
        if next(left, None) is None:
            raise Killed
        original(a, b)

    return rename


def test_old_set_goes_and_strangers_stay(tmp_path: Path) -> None:
    out = OutputDirectory(tmp_path / "out")
    out.publish(OLD)
    (tmp_path / "far.txt").write_bytes(b"mine")
    (tmp_path / "out" / "notes.txt").write_bytes(b"mine")
    (tmp_path / "out" / "pictures").mkdir()
    (tmp_path / "out" / "pictures" / "run.json").write_bytes(b"mine")
    out.publish(NEW)
    strangers = {"notes.txt": b"mine", "pictures/run.json": b"mine"}
    assert tree(tmp_path / "out") == NEW | strangers
    assert (tmp_path / "far.txt").exists()
    assert sorted(os.listdir(tmp_path / "out")) == ["inspection.json", "notes.txt", "pictures", "run.json"]


def test_a_strangers_file_beside_a_run_s_results_stays_where_a_run_fails(tmp_path: Path) -> None:
    out = OutputDirectory(tmp_path)
    out.publish(OLD)
    (tmp_path / "handeye.json").write_bytes(b"mine")
    assert out.supersede() is not None
    assert (tmp_path / "handeye.json").read_bytes() == b"mine"


def test_a_run_replaces_no_result_that_it_reads(tmp_path: Path) -> None:
    out = OutputDirectory(tmp_path)
    out.publish(OLD)
    (name,) = [name for name in OLD if name != "run.json"][:1]
    (tmp_path / "part.h5").write_bytes(b"mine")
    with out.reserved([tmp_path / "part.h5"]):
        pass
    with (
        pytest.raises(OutputError, match=rf"{name}: is a result of the run before") as told,
        out.reserved([Path(os.path.relpath(tmp_path / name))]),
    ):
        pass
    assert not told.value.supersedes
    assert tree(tmp_path) == OLD | {"part.h5": b"mine"}


def test_results_without_a_run_json_are_results_still(tmp_path: Path) -> None:
    (tmp_path / "inspection.json").write_bytes(b"old")
    (tmp_path / "run.json").write_bytes(b"{broken")
    assert OutputDirectory(tmp_path).supersede() is not None
    assert not (tmp_path / "inspection.json").exists()


@pytest.mark.parametrize(
    ("name", "beside"),
    [("inspection.json", None), ("report.html", None), ("plate.csv", None), ("run.json", b"{}"), ("report.html", OLD)],
)
def test_a_file_that_no_run_has_written_is_never_replaced(tmp_path: Path, name: str, beside: Any) -> None:
    out = OutputDirectory(tmp_path / "out")
    out.publish({key: OLD[key] for key in ("toolpath.json", "run.json")} if beside is OLD else {})
    (tmp_path / "out" / name).write_bytes(beside if name == "run.json" else b"mine")
    before = tree(tmp_path)
    with pytest.raises(OutputError, match=rf"{name}: no run has written it .* another --out") as told, out.reserved():
        out.publish({name: b"new", **NEW})
    assert tree(tmp_path) == before
    assert not told.value.supersedes


def test_results_that_a_killed_failure_moved_in_part_do_not_bar_the_next_run(tmp_path, monkeypatch):
    out = OutputDirectory(tmp_path / "out")
    out.publish(OLD)
    with monkeypatch.context() as patch:
        patch.setattr("workbench.pipeline.output.os.rename", killed_rename(1))
        with pytest.raises(Killed):
            out.supersede()
    with out.reserved():
        out.publish(NEW)
    assert tree(tmp_path / "out").items() >= NEW.items()


def test_failure_while_writing_leaves_the_old_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = OutputDirectory(tmp_path / "out")
    out.publish(OLD)

    def full(self: Path, *arguments: Any, **more: Any) -> Any:
        if self.name == "run.json" and arguments == ("wb",):
            raise OSError(28, "No space left on device")
        return original(self, *arguments, **more)

    original = Path.open
    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(OutputError, match="cannot be written: No space left on device"):
        out.publish(NEW)
    assert tree(tmp_path / "out") == OLD
    with pytest.raises(OutputError):
        OutputDirectory(tmp_path / "other").publish(NEW)
    assert os.listdir(tmp_path) == ["out"]


def test_directory_in_the_place_of_a_result(tmp_path: Path) -> None:
    (tmp_path / "inspection.json").mkdir()
    with pytest.raises(OutputError, match=r"inspection\.json: is a directory in the place of a result"):
        OutputDirectory(tmp_path).publish(NEW)
    assert os.listdir(tmp_path) == ["inspection.json"]


@pytest.mark.parametrize("place", ["file", "file/below", "dangling", "/proc/nowhere", "nul\0", "x" * 300, "x" * 250])
def test_unusable_place_is_found_before_the_work(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to(tmp_path / "gone")
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(OutputError), OutputDirectory(tmp_path / place).reserved():
        pass
    assert sorted(os.listdir(tmp_path)) == before


def test_results_of_a_running_run_are_not_superseded(tmp_path: Path) -> None:
    out = OutputDirectory(tmp_path)
    out.publish(OLD)
    with out.reserved(), pytest.raises(OutputError, match="another run"):
        OutputDirectory(tmp_path).supersede()
    assert tree(tmp_path) == OLD


class Killed(BaseException):
    """Stands for SIGKILL: nothing is tidied up after it."""


@pytest.mark.parametrize("after", range(7))
def test_killed_between_any_two_renames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    """Three old files go out, two new ones come in: whatever the moment, the next run finds one whole set."""
    out = OutputDirectory(tmp_path / "out")
    out.publish(OLD)
    with monkeypatch.context() as patch:
        patch.setattr("workbench.pipeline.output.os.rename", killed_rename(after))
        patch.setattr("workbench.pipeline.output.shutil.rmtree", lambda *_, **__: None)
        with pytest.raises(Killed) if after < 5 else contextlib.nullcontext():
            out.publish(NEW)
    whole = (tmp_path / "out" / "run.json").exists()
    assert not whole or tree(tmp_path / "out").items() >= (OLD if after == 0 else NEW).items()
    with OutputDirectory(tmp_path / "out").reserved():
        pass
    assert tree(tmp_path) == {f"out/{name}": content for name, content in NEW.items()}


@pytest.mark.parametrize("after", range(5))
def test_a_rename_that_fails_puts_all_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    out = OutputDirectory(tmp_path / "out")
    out.publish(OLD)
    left = [after]

    def rename(a: Path, b: Path) -> None:
        left[0] -= 1
        if left[0] == -1:
            raise OSError(5, "Input/output error")
        original(a, b)

    original = os.rename
    monkeypatch.setattr("workbench.pipeline.output.os.rename", rename)
    with pytest.raises(OutputError, match="Input/output error"):
        out.publish(NEW)
    assert tree(tmp_path) == {f"out/{name}": content for name, content in OLD.items()}


def test_a_set_that_was_never_complete_is_cleared_away(tmp_path: Path) -> None:
    out = OutputDirectory(tmp_path / "out")
    out.publish(OLD)
    for place in (tmp_path, tmp_path / "out"):
        (place / ".out.partial-x").mkdir()
        (place / ".out.partial-x" / "inspection.json").write_bytes(b"half")
    (tmp_path / "out" / ".out.partial-x" / ".moving").write_text('{"old": [')
    with out.reserved():
        pass
    assert tree(tmp_path) == {f"out/{name}": content for name, content in OLD.items()}


def test_the_lock_of_a_killed_run_goes_and_that_of_a_running_one_stays(tmp_path: Path) -> None:
    """A run that was killed just after its directory had appeared leaves the lock that it held beside it."""
    out, lock = OutputDirectory(tmp_path / "out"), tmp_path / ".out.lock"
    out.publish(OLD)
    lock.touch()
    with locked(lock), out.reserved():
        assert lock.exists()
    lock.touch()
    with out.reserved():
        assert not lock.exists()


def test_a_run_killed_while_it_tidies_up_leaves_its_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both sets have a file of one name; the old one is gone from the staged directory, the rest of that is not."""
    both = {**NEW, "plate.csv": b"new"}
    out = OutputDirectory(tmp_path / "out")
    out.publish(OLD)

    def killed(staged: Path, **_: object) -> None:
        (staged / f"plate.csv{OLD_NAME}").unlink()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("workbench.pipeline.output.shutil.rmtree", killed)
        with pytest.raises(KeyboardInterrupt):
            out.publish(both)
    with out.reserved():
        assert tree(tmp_path / "out") == both
