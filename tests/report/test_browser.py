"""The report in a real browser, headless and with no network: the scenes show, turn, and tell a section's numbers."""

from __future__ import annotations

import dataclasses
import io
import json
import re
import time

import numpy as np
import pytest
from PIL import Image

from tests.made import files_of
from workbench.artefacts import Chapter, Scene, Strokes
from workbench.report import closed_loop, html, inspection, plan

playwright = pytest.importorskip("playwright.sync_api", reason="pages are not looked at in a browser: no playwright")
BEVEL, ROOT = (0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)  # blue and vermilion of Okabe and Ito


@pytest.fixture(scope="module")
def measured(part, hostile):
    """A part of which section 3 fails for a reason with an attack in it, and section 5 is hidden."""
    made = part(frames=120, columns=160, verdict="fail")
    sections = [dataclasses.replace(s, reason=hostile if s.index == 3 else s.reason) for s in made.inspection.sections]
    return dataclasses.replace(made, inspection=dataclasses.replace(made.inspection, sections=tuple(sections)))


@pytest.fixture(scope="module")
def file(measured, planned, by_formula, provenance, tmp_path_factory):
    """A closed loop's report: three chapters with a scene each, on disk."""
    raw = planned(frames=60, columns=60)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.report.scene.picture", lambda view: b"\x89PNG")  # the pictures are not looked at here
        chapters = (
            closed_loop(measured.inspection, by_formula(), cloud=measured.cloud, edge=measured.edge),
            plan(raw.cloud, raw.edge, raw.toolpath),
            inspection(measured.cloud, measured.edge, measured.inspection),
        )
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_bytes(html(chapters, provenance).content)
    return path


class Opened:
    """The page, what it asked for and what it complained of."""

    def __init__(self, browser, path, *, width=1100, before="", **options):
        self.context = browser.new_context(viewport={"width": width, "height": 900}, offline=True, **options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(300_000)  # a loaded machine draws slowly
        self.requests, self.complaints = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", lambda dialog: self.complaints.append(dialog.message))
        if before:
            self.page.add_init_script(before)
        self.page.goto(path.as_uri())
        playwright.expect(self.page.locator("figure.space:not([data-drawn])")).to_have_count(0)

    def scene(self, chapter):
        return Shown(
            self.page, self.page.locator("section.chapter", has=self.page.get_by_role("heading", name=chapter))
        )


class Shown:
    """One chapter's scene."""

    def __init__(self, page, chapter):
        self.page, self.chapter, self.figure = page, chapter, chapter.locator("figure.space")
        self.canvas, self.facts = self.figure.locator("canvas"), self.figure.locator(".facts-shown")

    def picture(self):
        self.canvas.scroll_into_view_if_needed()
        self.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        shown = Image.open(io.BytesIO(self.canvas.screenshot())).convert("RGB")
        return np.asarray(shown).astype(int)[4:-4, 4:-4]  # without the mark of the focus

    def told(self):
        names, values = (self.facts.locator(each).all_inner_texts() for each in ("dt", "dd"))
        return dict(zip(names, values, strict=True))

    def rows(self, which):
        """Rows that belong to the scene: of its chapter, or of the certificate where the chapter has one."""
        certified = "certified" in (self.chapter.get_attribute("class") or "").split()
        return (self.page.locator("section.certificate") if certified else self.chapter).locator(f"tr{which}")

    def middle(self):
        box = self.canvas.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


@pytest.fixture(scope="module")
def opened(browser, file):
    return Opened(browser, file)


@pytest.fixture
def scene(opened):
    """The inspection's scene, as it first looks."""
    shown = opened.scene("Inspection")
    shown.figure.get_by_role("button", name="Reset view").click()
    shown.canvas.focus()
    opened.page.keyboard.press("Escape")
    return shown


def share_of(picture, colour, within=40):
    return np.mean(np.abs(picture - np.array(colour)).max(axis=2) < within)


def test_it_opens_without_a_network_and_without_complaint(opened, file):
    assert opened.requests[0] == file.as_uri()
    assert all(url.startswith("data:") for url in opened.requests[1:])
    assert opened.complaints == []
    assert opened.page.locator("figure.space[data-drawn=yes]").count() == 3
    assert file.stat().st_size < 15e6


def test_the_part_shows_in_the_colours_of_its_faces(scene):
    picture = scene.picture()
    assert share_of(picture, BEVEL) > 0.02
    assert share_of(picture, ROOT) > 0.002
    assert 0.3 < share_of(picture, (255, 255, 255), 1) < 0.98


@pytest.mark.parametrize("chapter", ["Inspection", "Closed loop"])
@pytest.mark.parametrize("index", [1, 5, 8])
def test_a_section_tells_the_numbers_of_the_inspection_file(opened, measured, chapter, index):
    """As `inspection.json` has them; section 5 lies under the clamp."""
    shown = opened.scene(chapter)
    shown.figure.locator("button.mark", has_text=re.compile(f"^{index}$")).click()
    stored, told = json.loads(files_of(measured.inspection)["inspection.json"])["sections"][index - 1], shown.told()
    assert told["Section"] == f"{index}"
    assert told["Arc length"] == f"{stored['arc_length_mm']:.2f} mm"
    assert told["Verdict"].endswith(stored["verdict"])
    for key, u, name, width in (
        ("root_mm", "root_u_mm", "Root face ± U", 1e-3),
        ("bevel_deg", "bevel_u_deg", "Bevel angle ± U", 1e-2),
    ):
        assert told[name].endswith("°" if key.endswith("_deg") else " mm")
        said = re.findall(r"[\d.]+", told[name])
        if stored[key] is None:
            assert said == []
            continue
        assert float(said[0]) == pytest.approx(stored[key], abs=width)
        assert float(said[1]) == pytest.approx(2 * stored[u], rel=0.2)
    u_text = told["u of root face"]
    assert u_text == ("–" if stored["root_u_mm"] is None else f"{stored['root_u_mm']:.4f} mm")
    chosen = shown.rows(".chosen")
    assert chosen.count() == 1
    assert chosen.locator("th").inner_text() == f"{index}"


def test_a_row_brings_its_section_near_and_a_click_on_it_chooses_it(scene, opened):
    far = scene.picture()
    scene.rows("[data-mark='8']").click()
    assert scene.told()["Section"] == "8"
    assert np.mean(np.abs(scene.picture() - far).max(axis=2) > 30) > 0.1
    scene.canvas.focus()
    opened.page.keyboard.press("Escape")
    assert scene.facts.is_hidden()
    opened.page.mouse.click(*scene.middle())
    assert scene.told()["Section"] == "8"


def test_it_turns_moves_zooms_and_comes_back(scene, opened):
    first, x, y = scene.picture(), *scene.middle()
    seen = [first]
    mouse, keys = opened.page.mouse, opened.page.keyboard

    def drag(dx, dy):
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + dx, y + dy, steps=3)
        mouse.up()

    acts = [
        lambda: drag(120, 40),
        lambda: keys.press("ArrowLeft"),
        lambda: keys.press("Shift+ArrowUp"),
        lambda: keys.press("+"),
        lambda: mouse.wheel(0, 240),
    ]
    for act in acts:
        act()
        seen.append(scene.picture())
        assert np.mean(np.abs(seen[-1] - seen[-2]).max(axis=2) > 30) > 0.005
    keys.press("0")
    assert np.array_equal(scene.picture(), first)


def test_the_page_scrolls_until_the_view_is_clicked(scene, opened):
    bar, wheel = scene.figure.locator(".bar"), lambda: opened.page.mouse.wheel(0, 60)
    width, top = bar.bounding_box()["width"], opened.page.evaluate("scrollY")
    scene.canvas.evaluate("(canvas) => canvas.blur()")
    opened.page.mouse.move(*scene.middle())
    wheel()
    deadline = time.monotonic() + 120.0
    while opened.page.evaluate("scrollY") == top and time.monotonic() < deadline:
        time.sleep(0.02)
    assert opened.page.evaluate("scrollY") != top
    assert bar.bounding_box()["width"] == width
    scene.canvas.focus()
    wheel()
    scene.picture()
    assert bar.bounding_box()["width"] < width


def test_deviations_have_a_legend_and_groups_can_be_hidden(scene):
    by_face = scene.picture()
    scene.figure.locator("select").select_option(label="deviation from the measured faces")
    assert "mm or more" in scene.figure.locator(".legend").inner_text()
    deviation = scene.picture()
    assert share_of(deviation, BEVEL) < 0.5 * share_of(by_face, BEVEL)  # blue lines remain
    scene.figure.get_by_label("points").uncheck()
    assert share_of(scene.picture(), (255, 255, 255), 1) > share_of(deviation, (255, 255, 255), 1) + 0.03
    scene.figure.get_by_label("points").check()
    scene.figure.locator("select").select_option(label="face")
    assert np.array_equal(scene.picture(), by_face)


def test_a_layer_of_the_plan_is_chosen(opened):
    shown = opened.scene("Plan")
    shown.chapter.locator("tr[data-mark='3']").click()
    assert shown.told()["Height"] == "3.00 mm"


def test_text_out_of_files_is_text(opened, measured):
    shown = opened.scene("Inspection")
    shown.figure.locator("button.mark", has_text=re.compile("^3$")).click()
    assert '<script>alert("x")</script>' in shown.told()["Reason"]
    assert opened.complaints == []


def test_a_script_from_elsewhere_does_not_run(browser, file, tmp_path):
    """The page's policy names the one script that may: should text ever be taken for HTML, nothing happens."""
    page = file.read_text(encoding="utf-8").replace(
        "</header>", "</header><script>document.title = 'theirs'</script>", 1
    )
    path = tmp_path / "report.html"
    path.write_text(
        page.replace('<p class="sub">', '<p class="sub"><img src="data:," onerror="document.title = \'theirs\'">', 1),
        encoding="utf-8",
    )
    tampered, honest = Opened(browser, path), re.search("<title>(.*?)</title>", page)
    assert tampered.page.title() == honest[1] != "theirs"
    assert tampered.page.locator("figure.space[data-drawn=yes]").count() == 3
    assert any("Content Security Policy" in text for text in tampered.complaints)
    tampered.context.close()


def test_two_fingers_zoom_on_a_narrow_screen(browser, file):
    narrow = Opened(browser, file, width=400, has_touch=True, is_mobile=True)
    shown = narrow.scene("Inspection")
    shown.canvas.tap(position={"x": 8, "y": 8})
    shown.picture()  # the browser has seen that the view now takes what fingers do
    box, bar = shown.canvas.bounding_box(), shown.figure.locator(".bar")
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 400
    before, touch = bar.inner_text(), narrow.context.new_cdp_session(narrow.page)
    x, y = box["x"] + box["width"] / 2, box["y"] + 0.9 * box["height"]  # beside the numbers, which are buttons
    for apart, what in ((20, "touchStart"), (60, "touchMove"), (140, "touchMove"), (0, "touchEnd")):
        points = [{"x": x - apart, "y": y, "id": 1}, {"x": x + apart, "y": y, "id": 2}] if apart else []
        touch.send("Input.dispatchTouchEvent", {"type": what, "touchPoints": points})
    shown.picture()
    assert float(bar.inner_text().split()[0]) < float(before.split()[0])
    assert narrow.complaints == []
    narrow.context.close()


def test_without_webgl_words_stand_in_its_place(browser, file):
    without = Opened(browser, file, before="HTMLCanvasElement.prototype.getContext = () => null")
    assert without.page.locator("figure.space[data-drawn=no]").count() == 3
    assert "WebGL 2" in without.page.locator("figure.space").first.inner_text()
    without.context.close()


def test_a_program_is_played(browser, tmp_path):
    """A body goes 100 mm a frame while others stand; the words are the frame's, and it stops at the end."""
    square = np.array([[0, 0, 0], [40, 0, 0], [40, 0, 40], [0, 0, 40], [0, 0, 0]], float)
    red, blue = (np.tile(np.array(colour, np.uint8), (5, 1)) for colour in ((209, 31, 31), (31, 31, 209)))
    moved = np.tile(np.eye(4), (4, 1, 1))
    moved[:, 0, 3] = 100.0 * np.arange(4)
    before, behind = square - [50, 0, 0], square + np.array([400.0, 0, 0])
    ends = Strokes("ends", (before, behind), (blue, blue))
    said = tuple(f"line {k} <b>" for k in range(4))
    scene = Scene(
        np.zeros((0, 3)), (), (Strokes("body", (square,), (red,), moved=moved), ends), (), np.eye(3), frames=said
    )
    page = html((Chapter("Program", '<figure class="space"><p>none</p></figure>', scene=scene),))
    (tmp_path / "report.html").write_bytes(page.content)
    opened = Opened(browser, tmp_path / "report.html")
    shown, words = opened.scene("Program"), opened.page.locator(".played")

    def at():
        """Column of the body's middle, px, seen along the second axis."""
        return np.mean(np.nonzero(np.abs(shown.picture() - [209, 31, 31]).max(axis=2) < 60)[1])

    shown.figure.get_by_role("button", name="Along n").click()
    assert words.inner_text() == said[0]
    places = []
    for k in range(4):
        shown.figure.get_by_role("slider").fill(str(k))
        assert words.inner_text() == said[k]
        places.append(at())
    steps = np.diff(places)
    assert np.abs(steps).min() > 10
    assert steps == pytest.approx(steps[0], rel=0.06)  # lines of the others cross it
    shown.figure.get_by_role("button", name="Play").click()
    playwright.expect(words).to_have_text(said[3])
    playwright.expect(shown.figure.get_by_role("button", name="Play")).to_be_visible()
    assert opened.complaints == []
