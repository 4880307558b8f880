"""Compiled kernels are found again by what they are made of, and by nothing else."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from numba.core.codegen import get_host_cpu_features

from tests.seldom import seldom
from workbench.kernels import BASELINE
from workbench.user_folder import UserFolder

CONSTANTS = "LIMIT = 2.0\nUNUSED = 5.0\n"
INNER = """
from workbench.kernels import kernel
from room.constants import LIMIT


@kernel
def inner(a):
    return a * LIMIT
"""
OUTER = """
from workbench.kernels import kernel
from room.inner import inner

STEP = (1.0, 0.5)


@kernel
def outer(a):
    total = 0.0
    for i in range(len(a)):
        total += inner(a[i]) + STEP[1]
    return total


@kernel
def other(a):
    return a + 1.0
"""
USE = """
import numpy as np
from room.outer import other, outer
print(outer(np.ones(2)), other(1.0), sum(outer.stats.cache_hits.values()), outer.py_func(np.ones(2)))
"""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package of two kernels, one of which calls the other, whose constant comes from a third module; compiled."""
    made = tmp_path_factory.mktemp("compiled") / "room"
    made.mkdir()
    for name, text in {"__init__": "", "constants": CONSTANTS, "inner": INNER, "outer": OUTER}.items():
        (made / f"{name}.py").write_text(text)
    assert use(made) == "5.0 2.0 0 5.0"
    return made


@pytest.fixture
def room(compiled: Path, tmp_path: Path) -> Path:
    """The package and its kept kernels, in another place."""
    return Path(shutil.copytree(compiled.parent, tmp_path, dirs_exist_ok=True)) / "room"


def use(room: Path, code: str = USE, **variables: str) -> str:
    """What a new process prints; nothing but the sources may tell it of changes."""
    path = os.pathsep.join([str(room.parent), *sys.path])
    set_ = {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(room.parent / "kept"), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **set_, **variables})
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def kept(room: Path, name: str = "room") -> set[Path]:
    return set((room.parent / "kept").rglob(f"*{name}*.kernel"))


def test_a_kept_one_brings_none_of_the_modules_that_compiled_it(room: Path) -> None:
    text = (
        "import numpy as np\nfrom workbench.kernels import kernel\n\n@kernel\ndef middle(a):\n    return np.median(a)\n"
    )
    (room / "middle.py").write_text(text)
    code = (
        "import sys, numpy as np; from room.middle import middle; print(middle(np.arange(5.0)));"
        "print([name for name in ('numba.np.arraymath', 'scipy.linalg') if name in sys.modules])"
    )
    use(room, code)
    assert use(room, code) == "2.0\n[]"


def test_the_order_of_a_set_of_options_is_no_other_kernel(room: Path) -> None:
    outer = (room / "outer.py").read_text()
    (room / "outer.py").write_text(outer.replace("@kernel", '@kernel(fastmath={"nsz", "arcp", "contract"})'))
    use(room, PYTHONHASHSEED="1")
    made = kept(room)
    assert use(room, PYTHONHASHSEED="3") == "5.0 2.0 1 5.0"
    assert kept(room) == made


@pytest.mark.skipif(
    not set(BASELINE[1].split(",")) <= set(get_host_cpu_features().split(",")), reason="a processor of another family"
)
def test_kernels_of_a_wheel_serve_where_none_is_kept(room: Path) -> None:
    """Compiled for a family of processors elsewhere; what is damaged or of other sources is compiled."""
    name, features = BASELINE
    for path in kept(room):
        path.unlink()
    use(room, NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=features)
    shipped = room.parent / "shipped"
    shipped.mkdir()
    for path in kept(room):
        path.rename(shipped / path.name)
    code = f"from pathlib import Path; from workbench import kernels; kernels.SHIPPED = Path({str(shipped)!r}){USE}"
    assert use(room, code) == "5.0 2.0 1 5.0"
    assert kept(room) == set()
    for path in shipped.iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    assert use(room, code) == "5.0 2.0 0 5.0"


@pytest.mark.parametrize(
    ("module", "old", "new", "now"),
    [
        ("constants", "LIMIT = 2.0", "LIMIT = 3.0", "7.0 2.0 0 7.0"),  # a constant of a module imported by one imported
        ("outer", "STEP = (1.0, 0.5)", "STEP = (1.0, 1.5)", "7.0 2.0 0 7.0"),
        ("inner", "a * LIMIT", "a * LIMIT + 0.0 * 7", "5.0 2.0 0 5.0"),
        *seldom(("inner", "a * LIMIT", "a / LIMIT", "2.0 2.0 0 2.0")),
    ],
)
def test_kernels_of_changed_sources_are_not_used(room: Path, module: str, old: str, new: str, now: str) -> None:
    others, path = kept(room, "other"), room / f"{module}.py"
    text, times = path.read_text(), path.stat()
    assert old in text
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # a checkout may restore times
    assert use(room) == now
    assert kept(room, "other") == others  # what does not rest on it is not compiled again
    path.write_text(text)
    if module == "constants":
        assert use(room) == "5.0 2.0 1 5.0"  # and the first ones are still there


def test_a_named_tuple_whose_fields_change_places_is_another_one(room: Path) -> None:
    text = """
from typing import NamedTuple
from workbench.kernels import kernel

class Pair(NamedTuple):
    one: float
    two: float

@kernel
def first(pair):
    return pair.one

@kernel
def made(one):
    return first(Pair(one=one, two=2.0))
"""
    code = "from room.pairs import *; print(first(Pair(one=1.0, two=2.0)), made(1.0), *first.stats.cache_hits.values())"
    (room / "pairs.py").write_text(text)
    assert use(room, code) == "1.0 1.0"
    assert use(room, code) == "1.0 1.0 1"
    (room / "pairs.py").write_text(text.replace("one: float\n    two: float", "two: float\n    one: float"))
    assert use(room, code) == "1.0 1.0"


def test_a_new_process_finds_them_again_whatever_comments_and_unused_constants_say(room: Path) -> None:
    before = kept(room)
    assert len(before) == 3
    (room / "constants.py").write_text(f"# why\n{CONSTANTS.replace('5.0', '6.0')}")
    (room / "outer.py").write_text(f'"""A docstring."""\n{OUTER}')
    assert use(room) == "5.0 2.0 1 5.0"
    assert kept(room) == before


def test_damaged_ones_are_compiled_anew(room: Path) -> None:
    for name in ("outer", "other", "inner"):  # a bit of the one that is counted, the end of another
        (path,) = kept(room, f"{name}-")
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(bytes(content) if name == "outer" else content[:20])
    assert use(room) == "5.0 2.0 0 5.0"


def test_of_two_processes_at_once_one_compiles(room: Path) -> None:
    for path in kept(room):
        path.unlink()
    code = """
import time
from workbench.kernels import Kept
save = Kept.save_overload
def late(*arguments):
    time.sleep(1.0)
    save(*arguments)
Kept.save_overload = late
from room.outer import other
print(other(1.0), sum(other.stats.cache_misses.values()))
"""
    with ThreadPoolExecutor(2) as pool:
        assert sorted(pool.map(lambda _: use(room, code), range(2))) == ["2.0 0", "2.0 1"]


def test_nowhere_to_keep_them_is_no_reason_not_to_run(room: Path) -> None:
    """A service without a home, on a read-only root: nothing may be written, and nothing is said in vain."""
    nowhere = {name: str(room / "constants.py" / "x") for name in ("NUMBA_CACHE_DIR", "HOME", "XDG_CACHE_HOME")}
    code = f"import tempfile; tempfile.tempdir = {str(room / 'constants.py')!r}\n{USE}"
    code += "from workbench.user_folder import folder; print(folder().path, folder().note())"
    said = use(room, code, **nowhere)
    assert said.startswith("5.0 2.0 0 5.0\nNone not kept: ")
    assert said.count("\n") == 1


def test_a_temporary_folder_stands_in(tmp_path, monkeypatch, recwarn):
    blocked = tmp_path / "file"
    blocked.touch()
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    found = UserFolder()
    assert found.path.parent == tmp_path
    assert found.path.stat().st_mode & 0o777 == 0o700
    assert str(blocked) in found.note()
    assert not recwarn.list


def test_code_that_others_may_write_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    first = UserFolder().path
    assert first.parent == tmp_path
    first.chmod(0o777)
    second = UserFolder()
    assert second.path != first
    assert "others may write it" in second.note()
