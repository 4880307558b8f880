"""The page in a real browser, with the mistakes of its users: one server, one browser, one recording."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.importing.test_draft import write
from tests.page.conftest import Client, opened
from tests.pipeline.test_follow import writing
from workbench.scan import read

playwright = pytest.importorskip("playwright.sync_api", reason="the page is not tried in a browser: no playwright")
SAMPLE = Path(__file__).parents[2] / "data" / "synthetic" / "milled_edge.h5"
WAIT_MS = 120_000


class Shop(NamedTuple):
    """The folder, its server, and a browser."""

    folder: Path
    client: Client
    browser: Any

    def at(self, path: str) -> Any:
        """A new tab; what a script does wrong there fails the test."""
        tab = self.browser.new_page(viewport={"width": 390, "height": 800}, locale="de-DE")
        tab.on("pageerror", lambda error: pytest.fail(f"{path}: {error}"))
        tab.set_default_timeout(WAIT_MS)
        tab.goto(f"http://127.0.0.1:{self.client.server.server_port}{self.client.root}{path}")
        assert tab.evaluate("document.documentElement.scrollWidth") <= 390
        return tab


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shop]:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no Chromium")
    folder = tmp_path_factory.mktemp("shop")
    playwright.expect.set_options(timeout=WAIT_MS)
    with opened(folder) as client, playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        yield Shop(folder, client, browser)
        browser.close()


def test_the_operator_s_page_waits_measures_and_says_what_next(shop: Shop) -> None:
    """Half a file is told, and the page waits on; a whole one passes."""
    shop.client.json("POST", "/api/presets", {"name": "P", "pipeline": "inspect_bevel", "inputs": {"part_id": "P-7"}})
    tab = shop.at("/operator?preset=P")
    verdict, todo = tab.locator("#verdict"), tab.locator("#todo")
    playwright.expect(todo).to_contain_text("Waiting")
    tab.wait_for_timeout(1000)  # it has seen the empty folder
    (shop.folder / "half.h5").write_bytes(SAMPLE.read_bytes()[:10_000])
    playwright.expect(verdict).to_have_text("failed")
    playwright.expect(todo).to_contain_text("half.h5")
    shutil.copy(SAMPLE, shop.folder / "part-7.h5")
    playwright.expect(verdict).to_have_text("PASS")
    playwright.expect(todo).to_contain_text("P-7")
    playwright.expect(todo).to_contain_text("Continue with the next part")
    assert verdict.evaluate("one => parseFloat(getComputedStyle(one).fontSize)") > 80
    tab.close()


def test_a_recording_that_grows_is_drawn_and_then_turns_in_space(shop: Shop) -> None:
    """Its sections and sizes so far; at its end the verdict, and the view in space and nothing else of the report."""
    grown = shop.folder / "grown.h5"
    with writing(grown, last=48, alive=True):
        inputs = {"recording": grown.name}
        number = shop.client.json("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": inputs})["id"]
        tab = shop.at(f"/runs/{number}")
        drawing = tab.get_by_alt_text("so far")
        while not drawing.is_visible() and shop.client.json("GET", f"/api/runs/{number}")["state"] == "running":
            tab.wait_for_timeout(100)
        playwright.expect(tab.locator(".verdict")).to_have_text("running")
        playwright.expect(tab.locator(".step")).to_contain_text("frames so far: ")
        grown.with_suffix(".h5.go").touch()
        playwright.expect(tab.locator(".verdict")).to_have_text("PASS")
    playwright.expect(tab.locator("td.number").first).to_contain_text(re.compile(r"^\d,\d{3} ± 0,\d{3} mm$"))
    view = tab.frame_locator("iframe")
    playwright.expect(view.locator("figure.space")).to_be_visible()
    playwright.expect(view.get_by_role("heading", level=1)).to_be_hidden()
    assert not (shop.folder / "results" / str(number) / "so_far.svg").exists()
    tab.close()


def test_two_files_of_a_stranger_become_a_recording(shop: Shop, tmp_path: Path) -> None:
    """A wrong file is refused; open questions hold the recording back; by the keyboard alone from there."""
    wrong = tmp_path / "notes.exe"
    wrong.write_text("no scan")
    tab = shop.at("/")
    tab.get_by_label("Drop files here").set_input_files(wrong)
    playwright.expect(tab.get_by_role("alert")).to_contain_text("expected a recording")
    sources = write(tmp_path, read(recording=SAMPLE), "kuka_abc", ";", ",", 1.0)
    tab.get_by_label("Drop files here").set_input_files(sources)
    for source in sources:
        tab.get_by_label(source.name).check()
    tab.get_by_role("button", name="Make a recording").click()
    tab.wait_for_selector("[data-draft]")
    tab.get_by_label("poses length unit").select_option("m")
    playwright.expect(tab.get_by_role("alert")).to_contain_text("mm read as m")  # the flange would be 2 km away
    tab.get_by_label("poses length unit").select_option("mm")
    playwright.expect(tab.get_by_role("alert")).to_be_empty()
    playwright.expect(tab.locator("#drawing")).to_be_empty()
    playwright.expect(tab.frame_locator("#picture").get_by_role("heading", level=1)).to_have_text("preview.h5")
    tab.get_by_role("button", name="Make the recording").press("Enter")
    playwright.expect(tab.get_by_role("alert")).to_contain_text("Questions are open")
    tab.get_by_label("Name of the recording").fill("scan.h5")
    for box in tab.get_by_label("Confirmed").all():
        box.press("Space")
    tab.get_by_role("button", name="Make the recording").press("Enter")
    playwright.expect(tab.get_by_role("link", name="Use")).to_be_visible()
    assert list(read(recording=shop.folder / "scan.h5").not_confirmed) == []
    tab.close()


def test_a_cancelled_run_and_a_lost_server_are_told(shop: Shop) -> None:
    """Last: the server ends here."""
    with writing(shop.folder / "endless.h5", last=24, alive=True):
        inputs = {"recording": "endless.h5"}
        number = shop.client.json("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": inputs})["id"]
        tab, other = shop.at(f"/runs/{number}"), shop.at("/")
        tab.get_by_role("button", name="Cancel").click()
        playwright.expect(tab.locator(".verdict")).to_have_text("cancelled")
        assert shop.client.done(number)["state"] == "cancelled"
    playwright.expect(other.get_by_role("link", name="All runs")).to_be_visible()
    shop.client.server.shutdown()
    other.get_by_role("button", name="Look").first.click()
    playwright.expect(other.get_by_role("alert")).to_contain_text("does not answer")
