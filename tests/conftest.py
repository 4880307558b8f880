"""Shared fixtures: small stages of our own, the command run in this process, a browser."""

import gc
import os
import shutil
import signal
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from hypothesis import settings
from pydantic import Field

from tests import readers, shapes

shapes.install()  # before anything else of the package is imported

from workbench.artefacts import (  # noqa: E402
    Document,
    EdgeProfile,
    Gate,
    HandEye,
    Inspection,
    Provenance,
    Quantity,
    Requirements,
    Section,
)
from workbench.errors import InputError  # noqa: E402
from workbench.stage import REGISTRY, InputFile, Progress, Seed, stage  # noqa: E402

settings.register_profile("same", derandomize=True, deadline=None)  # the same examples everywhere; no time is measured
settings.load_profile("same")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell: Ctrl-C is tested all the same
    signal.signal(signal.SIGINT, signal.default_int_handler)


gc.disable()  # until all files are imported, of which nothing goes: a third of what that takes


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@dataclass
class Outcome:
    """What a command did."""

    status: int
    out: str
    err: str


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """`command("run", path, "--out", directory)` in this process."""
    from workbench.cli import main

    def run(*arguments: object) -> Outcome:
        capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        return Outcome(status, *capsys.readouterr())

    return run


@pytest.fixture(scope="session", autouse=True)
def forked_readers() -> Iterator[None]:
    """What a process of its own reads, it reads with libraries that are loaded once."""
    forked = readers.Forked()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.children.subprocess", forked)
        yield
    forked.end()


LOOK_AT_PICTURES = ("docs", "acceptance", "report")  # and at the sheets that they fill


@pytest.fixture(scope="module", autouse=True)
def few_speeds(request: pytest.FixtureRequest) -> Iterator[None]:
    """Where nobody looks at their pictures, limits of chatter are found at few speeds: half of what these take."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name not in LOOK_AT_PICTURES:
            patch.setattr("workbench.plugins.stiffness.milling_choice.FEWEST", 3)
        yield


@pytest.fixture
def demo() -> Iterator[Mapping[str, Callable[..., Any]]]:
    """The family `demo`: a reader, a filter, a merger, an inspection, a gate and a page, all quick."""

    @stage("demo.read")
    def read(*, recording: InputFile, seed: Seed = 0) -> HandEye:
        """Read a text file; its first line becomes the source."""
        lines = recording.read_text().splitlines()
        if not lines:
            raise InputError(str(recording), "expected at least one line")
        return HandEye(np.eye(4), source=f"{lines[0]}/{seed}")

    @stage("demo.turn")
    def turn(
        pose: HandEye,
        *,
        angle_deg: Annotated[float, Field(ge=-90, le=90, description="turn about z")] = 10.0,
        steps: Annotated[int, Field(ge=1, description="number of steps")] = 1,
        progress: Progress = None,
    ) -> HandEye:
        """Turn a pose about z. Says how far it is."""
        if progress:
            progress(0.5)
        return HandEye(pose.flange_from_profiler, source=f"{pose.source}>{angle_deg:g}x{steps}")

    @stage("demo.merge")
    def merge(poses: tuple[HandEye, ...]) -> Document:
        """Write the sources of several poses."""
        return Document("merged.txt", "+".join(pose.source for pose in poses).encode())

    @stage("demo.inspect")
    def inspect(pose: HandEye, *, root_mm: float = 1.5, fail: bool = False) -> Inspection:
        """Make an inspection of two sections, one of them hidden."""
        return inspection(root_mm, fail)

    @stage("demo.refine")
    def refine(inspection: Inspection, *, root_mm: float = 1.4) -> Inspection:
        """Say it again, better."""
        return replace(inspection, reason=f"refined to {root_mm:g}")

    @stage("demo.gate")
    def gate(inspection: Inspection) -> Gate:
        """Reject what fails."""
        return Gate(inspection.verdict != "fail", inspection.reason)

    @stage("demo.page")
    def page(inspection: Inspection, provenance: Provenance) -> Document:
        """Write a page."""
        return Document("report.html", f"{inspection.verdict} {provenance.inputs[0][2]}".encode())

    yield {"read": read, "turn": turn, "merge": merge, "inspect": inspect, "gate": gate, "page": page}
    forget_strangers()


# A real browser, headless.

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SOFTWARE = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # WebGL without a graphics card


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium; without one a page is not looked at, and the run's summary says so."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="pages are not looked at in a browser: no playwright"
    )
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip(f"pages are not looked at in a browser: no {', '.join(BROWSERS)} here (apt-get install chromium)")
    as_root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # Chromium asks for it
    with playwright.sync_playwright() as driver:
        try:
            started = driver.chromium.launch(executable_path=path, args=[*SOFTWARE, *as_root])
        except playwright.Error as error:
            pytest.skip(f"pages are not looked at in a browser: {path} does not start: {str(error).splitlines()[0]}")
        playwright.expect.set_options(timeout=300_000)
        yield started
        started.close()


def forget_strangers() -> None:
    """Take out of the registry what a test has put in."""
    for name, known in list(REGISTRY.items()):
        if not known.function.__module__.startswith("workbench."):
            del REGISTRY[name]


def bevel_sizes(
    root_mm: float | None, root_u_mm: float | None, bevel_deg: float | None, bevel_u_deg: float | None
) -> dict[str, Quantity]:
    """Sizes of a section of a milled bevel; None: not measured."""
    found = {"root_mm": (root_mm, root_u_mm), "bevel_deg": (bevel_deg, bevel_u_deg)}
    return {name: Quantity.of(name, np.array(v, float), {"all": np.array(u, float)}) for name, (v, u) in found.items()}


def inspection(root_mm: float, fail: bool) -> Inspection:
    """An inspection with a measured and a hidden section, NaN in its profile."""
    x, y, z = np.eye(3)
    verdict = "fail" if fail else "undecided"
    sizes, told = bevel_sizes(root_mm, 0.004, 40.1, 0.02), "fail" if fail else "pass"
    seen = Section(1, 2.5, np.zeros(3), x, y, z, sizes, told, "", np.arange(3))
    hidden = Section(2, 7.5, 5 * x, x, y, z, bevel_sizes(*[None] * 4), "undecided", "hidden", np.arange(0))
    values = np.array([root_mm, np.nan])
    profile = EdgeProfile(np.array([0.0, 10.0]), np.array([[0, 0, 0], [10.0, 0, 0]]), values, values, values, values)
    return Inspection((seen, hidden), profile, Requirements(), 1.645, verdict, "section 2 is hidden", "whole edge")


@pytest.fixture
def demo_document(demo: object, tmp_path: Path) -> dict[str, Any]:
    """A pipeline of the demo stages, with its input file in `tmp_path`."""
    (tmp_path / "part.txt").write_text("part-1\n")
    return {
        "version": 1,
        "title": "Demo",
        "inputs": {"recording": "part.txt", "angle_deg": 20, "fail": False},
        "stages": [
            {"stage": "demo.read", "recording": "${recording}"},
            {"stage": "demo.turn", "angle_deg": "${angle_deg}"},
            {"stage": "demo.inspect", "fail": "${fail}"},
            {"stage": "demo.gate"},
            {"stage": "demo.page"},
        ],
    }
