"""What is declared, locked, installed and imported agree."""

import ast
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
LOCK = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if not line.startswith("#")]
MODULE_OF = {
    "scikit-image": "skimage",
    "pin": "pinocchio",
    "python-fcl": "fcl",
}
COMPANIONS = {"markupsafe", "mpl_toolkits", "pydantic_core", "vtkmodules"}  # of jinja2, matplotlib, pydantic, pyvista
LATER = {"scikit-image"}  # for stages that are still to come
HEAVY = {"fcl", "h5py", "matplotlib", "numba", "numpy", "open3d", "pinocchio", "pydantic", "pyvista", "scipy"} | {
    "skimage",
    "vtkmodules",
}


def distributions(requirements):
    return {re.split(r"[<>=;\[ ]", requirement)[0].lower().replace("_", "-") for requirement in requirements}


def imported_packages():
    """First names of all absolute imports in workbench/, the standard library left out."""
    found = set()
    for path in (ROOT / "workbench").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {"workbench"}


def test_the_lock_has_exact_versions_and_nothing_else():
    assert LOCK
    assert [line for line in LOCK if not re.fullmatch(r"[a-z0-9.-]+==[0-9][0-9a-z.+]*", line)] == []


def test_every_declared_dependency_is_locked():
    declared = distributions(PROJECT["project"]["dependencies"] + PROJECT["dependency-groups"]["dev"])
    assert declared - distributions(LOCK) == set()


def test_what_is_imported_is_declared_and_what_is_declared_is_imported():
    declared = distributions(PROJECT["project"]["dependencies"])
    modules = {MODULE_OF.get(name, name) for name in declared}
    imported = imported_packages()
    assert imported - modules - COMPANIONS == set()
    assert {name for name in declared - LATER if MODULE_OF.get(name, name) not in imported} == set()


@pytest.mark.parametrize("point", metadata.entry_points(group="workbench.stages"), ids=lambda point: point.name)
def test_every_family_of_stages_imports(point):
    point.load()


def test_entry_points_are_those_of_the_project_file():
    installed = {point.name: point.value for point in metadata.entry_points(group="workbench.stages")}
    assert PROJECT["project"]["entry-points"]["workbench.stages"].items() <= installed.items()


@pytest.mark.parametrize("module", ["workbench", "workbench.cli"])
def test_importing_the_command_loads_nothing_heavy(module):
    code = f"import sys, {module}; print(*{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert HEAVY & set(done.stdout.split()) == set()


def test_a_built_wheel_holds_every_file_of_the_package_and_nothing_else(tmp_path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, capture_output=True, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    files = (ROOT / "workbench").rglob("*")
    assert names == {str(path.relative_to(ROOT)) for path in files if path.is_file() and not made_by_a_tool(path)}


def made_by_a_tool(path):
    return "__pycache__" in path.parts
