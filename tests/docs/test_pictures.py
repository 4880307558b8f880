"""Every stage's page shows what its example makes; what is drawn is where the numbers say."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from scripts.pictures.__main__ import MOST_BYTES, chart, picture
from scripts.pictures.kinds import DRAWN
from scripts.pictures.panels import Curve, Panel, Picture, drawn
from workbench.artefacts import Chapter
from workbench.pieces import figure_html
from workbench.pipeline.catalogue import every_stage, makes
from workbench.stage import Stage

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs/stages"
STAGES = {name: one for name, one in every_stage()[0].items() if one.function.__module__.startswith("workbench.")}
SHOWN = re.compile(r"!\[\]\(pictures/(\S+\.svg)\)\n\n\*(.+)\.\*")
DRAWABLE = set(DRAWN) - {"Document"}  # some documents are
SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize("name", STAGES)
def test_the_page_of_a_stage_shows_what_it_makes(name: str) -> None:
    """If this fails: python -m scripts.pictures, then python -m scripts.stage_pages"""
    page = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    shown = SHOWN.findall(page)
    if not shown:
        assert not {one.strip() for one in makes(STAGES[name]).split(",")} & DRAWABLE
        return
    [(file, words)] = shown
    content = (PAGES / "pictures" / file).read_bytes()
    root = ElementTree.fromstring(content)
    assert file == f"{name}.svg"
    assert root.tag == f"{SVG}svg"
    assert root.findtext(f"{SVG}title") == words
    assert len(content) < MOST_BYTES == 60_000
    assert any(one.text and one.text.strip() for one in root.iter(f"{SVG}tspan")) or root.findall(f".//{SVG}text")


def test_no_picture_is_left_over_and_all_together_are_small() -> None:
    files = [*(PAGES / "pictures").iterdir()]
    assert {file.stem for file in files} <= set(STAGES)
    assert {file.suffix for file in files} == {".svg"}
    assert sum(file.stat().st_size for file in files) < 1_500_000


@pytest.mark.parametrize("name", ["path.read", "cloud.read", "stiffness.deflection", "calibrate.tcp"])
def test_a_picture_is_what_the_example_makes(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    content = picture(STAGES[name])
    kept = PAGES / "pictures" / f"{name}.svg"
    assert structure(content) == structure(kept.read_bytes()) if content else not kept.exists()


def structure(svg: bytes) -> tuple[Counter[str], list[str]]:
    elements = [*ElementTree.fromstring(svg).iter()]
    return Counter(one.tag for one in elements), [one.text for one in elements if one.text and one.text.strip()]


def test_an_example_that_does_not_call_its_stage_is_told() -> None:
    def read() -> Any:
        """Nothing.

        Example:
            >>> 1 + 1
            2
        """

    read.__module__ = "workbench.cloud.read"
    with pytest.raises(SystemExit, match=r"test\.read: its example does not call it as workbench\.cloud\.read"):
        picture(Stage("test.read", read))


def test_a_chapters_chart_keeps_its_numbers_and_is_passed_over_where_it_is_large() -> None:
    small = b"<svg xmlns='http://www.w3.org/2000/svg'><path d='M1.23456 2'/><text>U = 0.00235 mm</text></svg>"
    large = small.replace(b"M1", b"M1 1" * MOST_BYTES)
    html = figure_html(large, "Large") + figure_html(small, "Root face < 2 mm")
    made = chart(Chapter("A chapter", html))
    assert made is not None
    root = ElementTree.fromstring(made)
    assert [one.text for one in root if one.text] == ["Root face < 2 mm", "U = 0.00235 mm"]
    assert b"M1.234 2" in made
    assert chart(Chapter("A chapter", figure_html(large, "Large"))) is None


def test_one_scale_both_ways_is_one() -> None:
    square = Curve([0.0, 3.0, 3.0, 0.0, 0.0], [0.0, 0.0, 3.0, 3.0, 0.0])
    svg = drawn(Picture("A square", [Panel("x, mm", "y, mm", [square], equal=True)])).decode()
    line = next(path for path in re.findall(r' d="([^"]+)"', svg) if path.count("L") == 4)
    x, y = zip(*(map(float, pair.split()) for pair in re.split("[ML]", line)[1:]), strict=True)
    assert max(x) - min(x) == pytest.approx(max(y) - min(y), abs=0.02)


def test_bars_lie_beside_their_names_with_their_lengths() -> None:
    bars = Curve([1.0, -2.0], [0, 1], how="bars")
    svg = drawn(Picture("Bars", [Panel("mm", "", [bars], names=["first", "second"])])).decode()
    rings = [path for path in re.findall(r' d="([^"]+Z)" fill', svg) if path.count("L") == 3]
    widths, heights = [], []
    for ring in rings:
        places = [[float(one) for one in pair.split()] for pair in re.split("[ML]", ring.rstrip("Z"))[1:]]
        widths.append(places[1][0] - places[0][0])
        heights.append((places[0][1] + places[2][1]) / 2.0)
    at = {
        name: float(y) for y, name in re.findall(r"translate\([\d.]+ ([\d.]+)\)[^>]*><tspan[^>]*>(first|second)<", svg)
    }
    assert widths[1] / widths[0] == pytest.approx(-2.0, rel=1e-3)
    assert heights == pytest.approx([at["first"], at["second"]], abs=0.02)
