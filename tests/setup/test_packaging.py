"""What is declared, locked, installed and imported agree."""

import ast
import itertools
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from scripts.ratchet import within
from workbench import __version__
from workbench.extras import DISTRIBUTION, EXTRA_OF

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def locked(name):
    """Requirement (with its condition) and digests of each package of a lock."""
    text = re.sub(r"^#.*\n", "", (ROOT / name).read_text(), flags=re.MULTILINE).replace("\\\n", " ")
    return {line.split(" --hash")[0].strip(): re.findall(r"--hash=(\S+)", line) for line in text.splitlines()}


USER, DEV = locked("requirements.lock"), locked("requirements-dev.lock")
MODULE_OF = {
    "scikit-image": "skimage",
    "lazy-loader": "lazy_loader",
    "open3d-cpu": "open3d",
    "pillow": "PIL",
    "pin": "pinocchio",
    "python-fcl": "fcl",
}
# of numba, jinja2, matplotlib, pydantic and pyvista
COMPANIONS = {"llvmlite", "markupsafe", "mpl_toolkits", "pydantic_core", "vtkmodules"}
BY_FSSPEC = {"s3fs"}


def distributions(requirements):
    return {re.split(r"[<>=;\[ ]", requirement)[0].lower().replace("_", "-") for requirement in requirements}


def imported_packages():
    """First names of all absolute imports in workbench/, without the standard library and what types alone need."""
    found = set()
    for path in (ROOT / "workbench").rglob("*.py"):
        every = list(within(ast.parse(path.read_text())))
        ifs = [one for one in every if isinstance(one, ast.If)]
        guarded = [one for one in ifs if getattr(one.test, "id", "") == "TYPE_CHECKING"]
        for_types = {id(node) for one in guarded for branch in one.body for node in within(branch)}
        for node in every:
            if id(node) in for_types:
                continue
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module.split(".")[0])
            elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("Extra", "library"):
                found.add(node.args[0].value.split(".")[0])
    return found - set(sys.stdlib_module_names) - {"workbench"}


@pytest.mark.parametrize("lock", [USER, DEV], ids=["user", "dev"])
def test_a_lock_has_exact_versions_with_digests_and_nothing_else(lock):
    assert len(lock) > 100
    pinned = r"[a-z0-9.-]+==[0-9][0-9a-z.+]*( ; [a-z_]+ .*)?"
    assert [line for line in lock if not re.fullmatch(pinned, line)] == []
    assert [line for line, digests in lock.items() if not digests] == []
    assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", one) for digests in lock.values() for one in digests)


def test_users_and_developers_have_the_same_versions():
    of_dev = {line.split(" ;")[0]: digests for line, digests in DEV.items()}
    assert [line for line, digests in USER.items() if of_dev.get(line.split(" ;")[0]) != digests] == []


EXTRAS = PROJECT["project"]["optional-dependencies"]
IN_ALL = ("robot", "formats", "view", "page")


def of_extras(*names):
    """What the extras bring."""
    return [one for name in names for one in EXTRAS[name]]


def test_every_declared_dependency_is_locked():
    declared, groups = PROJECT["project"]["dependencies"], PROJECT["dependency-groups"]
    every = of_extras(*(set(EXTRAS) - {"all"}))
    assert distributions([*declared, *of_extras(*IN_ALL), *groups["install"]]) - distributions(USER) == set()
    assert distributions([*declared, *every, *itertools.chain(*groups.values())]) - distributions(DEV) == set()


def test_a_missing_package_is_told_with_the_extra_that_brings_it():
    brought = {name: {MODULE_OF.get(one, one) for one in distributions(of_extras(name))} for name in EXTRAS}
    assert PROJECT["project"]["name"] == DISTRIBUTION
    for extra in set(EXTRAS) - {"all"}:
        assert {module for module, name in EXTRA_OF.items() if name == extra} == brought[extra]


def test_what_is_imported_is_declared_and_what_is_declared_is_imported():
    declared = distributions([*PROJECT["project"]["dependencies"], *of_extras(*(set(EXTRAS) - {"all"}))])
    modules = {MODULE_OF.get(name, name) for name in declared}
    imported = imported_packages()
    assert imported - modules - COMPANIONS == set()
    assert {name for name in declared - BY_FSSPEC if MODULE_OF.get(name, name) not in imported} == set()


def test_entry_points_are_those_of_the_project_file():
    installed = {point.name: point.value for point in metadata.entry_points(group="workbench.stages")}
    assert PROJECT["project"]["entry-points"]["workbench.stages"].items() <= installed.items()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return built(tmp_path_factory.mktemp("wheel"))


def built(folder, **environment):
    """The wheel of this checkout, without isolation."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, capture_output=True, check=True, cwd=ROOT, env={**os.environ, **environment})
    (made,) = folder.glob("*.whl")
    return made


def test_a_built_wheel_holds_every_file_of_the_package_the_samples_and_nothing_else(wheel):
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    package = {str(path.relative_to(ROOT)) for path in files_below(ROOT / "workbench")}
    samples = {str(path.relative_to(ROOT)) for name in ("pipelines", "data") for path in files_below(ROOT / name)}
    assert names == package | {f"workbench/shipped/{name}" for name in samples}


def test_an_installed_wheel_runs_without_the_checkout(wheel, tmp_path):
    """From its own pipelines and data; the packages it needs are those of this environment."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "installed")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "installed")}

    def workbench(*arguments):
        command = [sys.executable, "-m", "workbench", *arguments]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True).stdout

    where = "import workbench; print(workbench.__file__)"
    place = subprocess.run([sys.executable, "-c", where], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert Path(place.stdout.strip()).is_relative_to(tmp_path)
    workbench("samples", "mine")
    workbench("run", "mine/pipelines/identify_stiffness.json", "--out", "out")
    assert json.loads((tmp_path / "out" / "stiffness.json").read_text())["loads"] > 0


def test_a_wheel_built_later_has_the_same_bytes(wheel, tmp_path):
    """Seconds later: file times would tell."""
    assert wheel.name == f"bevel_workbench-{__version__}-py3-none-any.whl"
    assert built(tmp_path).read_bytes() == wheel.read_bytes()


def test_a_wheel_with_kernels_is_one_platforms(tmp_path):
    kernels = tmp_path / "kernels"
    kernels.mkdir()
    (kernels / "room.one-0.kernel").write_bytes(b"code")
    made = built(tmp_path / "dist", WORKBENCH_KERNELS=str(kernels))
    assert not made.name.endswith("none-any.whl")
    assert zipfile.ZipFile(made).read("workbench/shipped/kernels/room.one-0.kernel") == b"code"


def files_below(folder):
    return (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
