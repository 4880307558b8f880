"""Families come by entry point: the project's own, strangers' plug-ins, and what to do when one is broken."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from workbench import Pipeline
from workbench.errors import PipelineError
from workbench.pipeline import catalogue

PLUGIN = '''
"""A stranger's plug-in."""
from workbench.api import Document, stage

@stage("plate.stamp")
def stamp(*, depth_mm: float = 0.1) -> Document:
    """Stamp a depth."""
    return Document("stamp.txt", str(depth_mm).encode())
'''


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A place on the path for distributions; the registry is as it was, afterwards."""
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))
    catalogue.families.cache_clear()
    yield site
    catalogue.families.cache_clear()
    sys.modules.pop("plate_plugin", None)
    for name, known in list(catalogue.REGISTRY.items()):
        if known.function.__module__ == "plate_plugin":
            del catalogue.REGISTRY[name]


def install(site: Path, module: str, family: str, text: str) -> None:
    (site / f"{module}.py").write_text(text)
    info = site / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[workbench.stages]\n{family} = {module}\n")
    catalogue.families.cache_clear()


def test_plugin_comes_by_the_same_door(site: Path, tmp_path: Path) -> None:
    install(site, "plate_plugin", "plate", PLUGIN)
    results = Pipeline({"version": 1, "stages": [{"stage": "plate.stamp", "depth_mm": 0.3}]}).run(tmp_path / "out")
    assert (tmp_path / "out" / "stamp.txt").read_text() == "0.3"
    assert results["plate.stamp"].name == "stamp.txt"
    assert "plate.stamp" in catalogue.every_stage()[0]


def test_plugin_may_add_to_a_family_of_the_project(site: Path) -> None:
    install(site, "plate_plugin", "cloud", PLUGIN.replace("plate.stamp", "cloud.stamp"))
    assert catalogue.families()["cloud"] == ("workbench.cloud", "plate_plugin")
    assert catalogue.find("cloud.stamp", "here").doc == "Stamp a depth."


def test_broken_plugin_is_one_line_and_harms_no_other(site: Path) -> None:
    install(site, "broken_plugin", "broken", "import a_package_that_is_not_there\n")
    with pytest.raises(PipelineError, match=r"'broken\.\*' \(broken_plugin\): cannot be imported: ModuleNotFoundError"):
        catalogue.find("broken.verb", "here")
    stages, broken = catalogue.every_stage()
    assert list(broken) == ["broken"]
    assert "scan.read" in stages


def test_without_metadata_the_projects_own_families_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "entry_points", lambda group: ())
    catalogue.families.cache_clear()
    try:
        assert catalogue.find("scan.read", "here").name == "scan.read"
    finally:
        catalogue.families.cache_clear()
