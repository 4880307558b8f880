"""Pages as they are printed and on narrow windows, in a real browser: what a test can tell of them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from workbench.artefacts import Part, Term, Uncertainty, Unseen
from workbench.batch.fleet import MOST_PARTS
from workbench.batch.fleet import page as fleet_page
from workbench.batch.part import Record
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.inspect import groove as inspect_groove
from workbench.report import closed_loop, html, inspection, plan
from workbench.report import groove as report_groove
from workbench.scan import fuse, read

A4_WIDTH_PX, A4_HEIGHT_PX = round((210 - 2 * 13) / 25.4 * 96), (297 - 2 * 14) / 25.4 * 96
ROOT = Path(__file__).parents[2]
GROOVE = ROOT / "data" / "synthetic" / "groove.h5"
LONG = "a name of a part that is much longer than names of parts are in most shops, revision 12"

WIDER = """() => [...document.querySelectorAll("body *")].filter((e) => {
  const box = e.getBoundingClientRect(), edge = window.innerWidth + 1;
  const scrolls = e.closest("table, pre, .scroll, figure");
  return box.width && box.right > edge && !e.closest(".across, .stage")
    && !(scrolls && scrolls.getBoundingClientRect().right <= edge);
}).map((e) => e.tagName + "." + e.className)"""
EMPTY = """() => [...document.querySelectorAll("h2, h3")].filter((h) => {
  if (!h.getBoundingClientRect().height) return false;
  for (let next = h.nextElementSibling; next; next = next.nextElementSibling) {
    if (/^H[123]$/.test(next.tagName)) return next.tagName <= h.tagName;
    if (next.getBoundingClientRect().height) return false;
  }
  return true;
}).map((h) => h.textContent)"""
CONTRAST = """() => {
  const light = (rgb) => rgb.map((c) => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)
    .reduce((sum, c, k) => sum + c * [0.2126, 0.7152, 0.0722][k], 0);
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const behind = (e) => { for (; e; e = e.parentElement) { const c = parse(getComputedStyle(e).backgroundColor);
    if (c.length < 4 || c[3] > 0) return c.slice(0, 3); } return [255, 255, 255]; };
  return [...document.querySelectorAll("body *")].filter((e) => !e.closest("[aria-hidden], .stage, script, style") &&
    [...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim()) && e.getBoundingClientRect().width).filter((e) => {
    const a = light(parse(getComputedStyle(e).color).slice(0, 3)), b = light(behind(e));
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) < 4.5;
  }).map((e) => e.tagName + "." + e.className + ": " + e.textContent.slice(0, 40));
}"""


def loop_page(part, planned, by_formula, provenance):
    """A closed loop's page with everything that can be long on its first page."""
    made, raw = part(frames=120, columns=120, verdict="fail", sections=30), planned(frames=60, columns=60)
    names = [f"source of uncertainty number {k}, told in words" for k in range(7)]
    terms = tuple(Term(name, "A", 0.001) for name in names)
    told = Uncertainty(
        not_included=tuple(
            Unseen(f"{k}", f"{k}: what is not included, in a sentence.", {"root_mm": 0.1}) for k in range(5)
        )
    )
    who = Part(part_id=LONG, sensor=LONG, robot=LONG, hand_eye=LONG, simulated=True)
    sections = tuple(
        dataclasses.replace(one, sizes={name: dataclasses.replace(q, terms=terms) for name, q in one.sizes.items()})
        for one in made.inspection.sections
    )
    measured = dataclasses.replace(made.inspection, sections=sections, uncertainty=told, part=who, reason=LONG)
    chapters = (
        closed_loop(measured, by_formula()),
        dataclasses.replace(
            plan(raw.cloud, raw.edge, raw.toolpath), not_checked=tuple(f"{k}: {LONG}" for k in range(12))
        ),
        inspection(made.cloud, made.edge, measured),
    )
    return html(chapters, provenance).content.decode()


def groove_page(provenance):
    """A groove's page with as many sizes as it has, all of them required."""
    cloud = denoise(fuse(read(recording=GROOVE)))
    found = segment_groove(cloud)
    wanted = {name: 1.0 for name in found.sizes}
    zones = {f"{name.rpartition('_')[0]}_tolerance_{name.rpartition('_')[2]}": [-0.5, 0.5] for name in wanted}
    made = report_groove(cloud, found, inspect_groove(found, nominal=wanted | zones))
    return html((made,), provenance).content.decode()


def batch_page():
    needs = {
        "root_nominal_mm": 1.5,
        "root_tolerance_mm": [-0.5, 0.5],
        "bevel_nominal_deg": 40,
        "bevel_tolerance_deg": [-1, 1],
    }
    rows = tuple(
        {
            "index": k,
            "arc_length_mm": 9.0 * k,
            "root_mm": 1.5,
            "root_u_mm": 0.006,
            "bevel_deg": 40.0,
            "bevel_u_deg": 0.04,
            "verdict": "undecided",
        }
        for k in range(1, 10)
    )
    parts = [
        Record(
            f"{LONG} {k}",
            "r.h5",
            "rejected",
            verdict="undecided",
            requirements=needs,
            sections=rows,
            identity={"simulated": True},
        )
        for k in range(MOST_PARTS + 20)
    ]
    return fleet_page([*parts, *(Record(f"{LONG} x{k}", "x.h5", "failed") for k in range(20))], "Fleet")


@pytest.fixture(scope="module")
def pages(part, planned, by_formula, provenance, tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.report.scene.picture", lambda view: b"\x89PNG")  # not looked at here
        files = {
            "loop": loop_page(part, planned, by_formula, provenance),
            "fleet": batch_page(),
            "groove": groove_page(provenance),
        }
    for name, text in files.items():
        (folder / f"{name}.html").write_text(text)
    return {name: folder / f"{name}.html" for name in files}


@pytest.fixture(scope="module", params=["loop", "fleet", "groove"])
def opened(request, pages, browser):
    made = browser.new_page()
    made.set_default_timeout(300_000)  # a loaded machine draws slowly
    made.goto(pages[request.param].as_uri())
    yield made
    made.close()


@pytest.fixture
def page(opened):
    """As it is first seen."""
    opened.emulate_media(media="screen")
    opened.set_viewport_size({"width": 1100, "height": 800})
    return opened


def test_the_first_printed_page_holds_one_a4_side(page):
    page.emulate_media(media="print")
    page.set_viewport_size({"width": A4_WIDTH_PX, "height": 900})
    high, needed, foot, end = page.evaluate("""() => { const c = document.querySelector(".certificate");
      const box = c.getBoundingClientRect(), foot = c.querySelector("footer").getBoundingClientRect();
      return [box.height, c.scrollHeight, foot.bottom, box.bottom]; }""")
    assert page.evaluate("() => document.documentElement.scrollWidth") <= A4_WIDTH_PX  # of all pages
    assert high <= A4_HEIGHT_PX
    assert needed <= high + 1
    assert foot <= end + 1
    assert page.evaluate("() => getComputedStyle(document.querySelector('.certificate')).breakAfter") == "page"


@pytest.mark.parametrize("width", [390, 760, 1100])
def test_nothing_is_wider_than_the_window(page, width):
    page.set_viewport_size({"width": width, "height": 800})
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    assert page.evaluate(WIDER) == []


@pytest.mark.parametrize("media", ["screen", "print"])
def test_no_heading_stands_over_nothing(page, media):
    page.emulate_media(media=media)
    assert page.evaluate(EMPTY) == []


def test_every_text_is_dark_enough(page):
    assert page.evaluate(CONTRAST) == []
