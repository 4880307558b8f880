"""A family of stages that does to its worker what the recording says; workers find it by its entry point."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

STRANGER = '''
"""Stages of a stranger's package: an inspection out of a text file, or what breaks a worker."""

import os, signal, time
from pathlib import Path

import numpy as np

from workbench.api import Document, Gate, InputError, InputFile, Inspection, stage
from workbench.artefacts import EdgeProfile, Quantity, Requirements, Section


@stage("breaking.inspect")
def inspect(*, recording: InputFile, shift_mm: float = 0.0) -> Inspection:
    """First line: what to do. Second line: root faces of the sections, mm."""
    what, values = recording.read_text().splitlines()
    if what == "slow":
        time.sleep(0.4)
    while what == "held" and not recording.with_name("go").exists():
        time.sleep(0.02)
    if what == "hang":
        time.sleep(1000)
    if what == "exit":
        os._exit(7)
    if what == "kill" or (what == "kill once" and not once(recording)):
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "segfault":
        import ctypes
        ctypes.string_at(0)
    if what == "unusable":
        raise InputError(str(recording), "expected something else")
    if what == "defect":
        raise ZeroDivisionError("a stage's own mistake")
    x, y, z = np.eye(3)
    roots = [None if text == "-" else float(text) + shift_mm for text in values.split()]
    frames = np.arange(1)

    def sizes(root):
        told = {"root_mm": (root, 0.01), "bevel_deg": (root and 40.0, 0.02)}
        return {name: Quantity.of(name, np.array(value, float), {"all": u}) for name, (value, u) in told.items()}

    sections = tuple(
        Section(i, 10.0 * i, i * x, x, y, z, sizes(root), "pass", "", frames)
        for i, root in enumerate(roots, 1)
    )
    verdict = "fail" if what == "reject" else "pass"
    empty = np.zeros(0)
    profile = EdgeProfile(empty, np.zeros((0, 3)), empty, empty, empty, empty)
    return Inspection(sections, profile, Requirements(), 1.645, verdict, what, "whole edge")


def once(recording: Path) -> bool:
    """Whether this recording has been seen before."""
    mark = recording.with_suffix(".seen")
    if mark.exists():
        return True
    mark.touch()
    return False


@stage("breaking.gate")
def gate(inspection: Inspection) -> Gate:
    """Reject what fails."""
    return Gate(inspection.verdict != "fail", inspection.reason)


@stage("breaking.page")
def page(inspection: Inspection) -> Document:
    """A page."""
    return Document("report.html", b"<p>" + inspection.verdict.encode())
'''


@pytest.fixture
def breaking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The stranger's package, installed for this process and those it starts; returns its module."""
    site = tmp_path / "site"
    info = site / "breaking-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "breaking.py").write_text(STRANGER)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: breaking\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[workbench.stages]\nbreaking = breaking\n")
    monkeypatch.setenv("PYTHONPATH", str(site))
    monkeypatch.syspath_prepend(str(site))
    from workbench.pipeline.catalogue import families
    from workbench.stage import REGISTRY
    from workbench.user_folder import package_digest

    families.cache_clear()
    package_digest.cache_clear()
    yield site / "breaking.py"
    families.cache_clear()
    sys.modules.pop("breaking", None)
    for name in [name for name in REGISTRY if name.startswith("breaking.")]:
        del REGISTRY[name]


@pytest.fixture
def pipeline(breaking: Path, tmp_path: Path) -> Path:
    """A pipeline of those stages."""
    path = tmp_path / "pipeline.json"
    stages = [
        {"stage": "breaking.inspect", "recording": "${recording}", "shift_mm": "${shift_mm}"},
        {"stage": "breaking.gate"},
        {"stage": "breaking.page"},
    ]
    inputs = {"recording": "none.h5", "shift_mm": 0.0}
    path.write_text(json.dumps({"version": 1, "title": "Breaking", "inputs": inputs, "stages": stages}))
    return path


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., str]:
    """`record("part-1", "pass", "1.5 1.6")` writes a recording and returns its path."""

    def write(name: str, what: str = "pass", roots: str = "1.5 1.6 1.4") -> str:
        path = tmp_path / "recordings" / f"{name}.h5"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"{what}\n{roots}\n")
        return str(path)

    return write


@pytest.fixture
def plain_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """No pictures: for tests that make many pages and look at none."""
    monkeypatch.setattr("workbench.batch.fleet.characteristics", lambda records: ())
