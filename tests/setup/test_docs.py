"""What the pages point at exists: linked files, files and functions named in the text, commands of make."""

import csv
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
LINK = re.compile(r"\]\(([^)#\s]+)")
NAMED_FILE = re.compile(r"`((?:workbench|docs|pipelines|scripts|tests|data|bench)/[\w./*-]*)`")
NAMED_OBJECT = re.compile(r"`(workbench(?:\.\w+)+)`")
ENTRY_POINT_GROUP = "workbench.stages"
MAKE = re.compile(r"`make ([a-z]+)`")


def named(pattern):
    """Every match with its page."""
    return [(page, match) for page in PAGES for match in dict.fromkeys(pattern.findall(page.read_text()))]


def missing(pattern, is_there):
    """`page: match` of every match that is not there."""
    return [f"{page.relative_to(ROOT)}: {match}" for page, match in named(pattern) if not is_there(page, match)]


def test_a_link_leads_to_a_file():
    assert missing(LINK, lambda page, to: to.startswith("https://") or (page.parent / to).exists()) == []


def test_a_file_that_is_named_exists():
    assert missing(NAMED_FILE, lambda page, name: any(ROOT.glob(name))) == []


def test_a_function_that_is_named_exists():
    def is_there(page, name):
        module, _, rest = name.rpartition(".")
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:
            return hasattr(importlib.import_module(module), rest)
        return True

    assert missing(NAMED_OBJECT, lambda page, name: name == ENTRY_POINT_GROUP or is_there(page, name)) == []


def test_a_make_target_that_is_named_exists():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert missing(MAKE, lambda page, target: target in targets) == []


def test_the_table_of_constants_has_those_of_the_code():
    for named, values, _ in list(csv.reader((ROOT / "docs/tables/method_constants.csv").open()))[1:]:
        first, *others = named.split(", ")
        module, _, name = first.rpartition(".")
        held = importlib.import_module(f"workbench.{module}")
        for constant, value in zip([name, *others], re.findall(r"[\d.]+", values), strict=False):
            assert getattr(held, constant) == float(value), f"{module}.{constant}"


def test_the_recording_written_by_its_page_is_read(tmp_path, monkeypatch):
    from workbench.scan import fuse, read

    (block,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "docs/recording.md").read_text(), re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(block, {})
    cloud = fuse(read(recording=tmp_path / "flat.h5"))
    points_mm = cloud.base_from_profiler @ [0.0, 0.0, 150.0, 1.0]
    assert points_mm[:, 2] == pytest.approx(750.0)  # the scanner looks down: 150 mm below the flange
    assert points_mm[[0, -1], 1] == pytest.approx([-50.0, 50.0])
