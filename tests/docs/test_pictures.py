"""Every stage's page shows what its example makes; what is drawn is where the numbers say."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path

import pytest

from scripts.pictures.__main__ import MOST_BYTES, picture
from scripts.pictures.kinds import DRAWN
from workbench.pipeline.catalogue import every_stage, makes

ROOT = Path(__file__).parents[2]
PAGES = ROOT / "docs/stages"
STAGES = {name: one for name, one in every_stage()[0].items() if one.function.__module__.startswith("workbench.")}
SHOWN = re.compile(r"!\[\]\(pictures/(\S+\.svg)\)\n\n\*(.+)\.\*")
DRAWABLE = set(DRAWN) - {"Document", "Chapter"}  # some are
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
