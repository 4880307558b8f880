"""The how-tos work as written: every ```sh block runs and prints what the page says; code is quoted, not retold."""

import pytest

from scripts.site.commands import ROOT, blocks, follow, lay_out

PAGES = sorted((ROOT / "docs/howto").glob("*.md"))
HEAVY = {"calibrate", "calibrate_tool", "plugin", "post_processor", "read_the_report"}  # whole pipelines
EXAMPLES = (ROOT / "docs/examples/welding", ROOT / "workbench/program")
QUOTED = {"python": "*.py", "toml": "pyproject.toml", "json": "*.json"}


@pytest.mark.parametrize(
    "page", [pytest.param(p, id=p.stem, marks=[pytest.mark.slow] if p.stem in HEAVY else []) for p in PAGES]
)
def test_every_command_runs_and_prints_what_the_page_says(page, tmp_path):
    assert follow(page.read_text(), lay_out(tmp_path)) >= 1


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_code_that_is_quoted_is_the_examples(page):
    for language, text in blocks(page.read_text()):
        if pattern := QUOTED.get(language):
            assert any(text in file.read_text() for folder in EXAMPLES for file in folder.rglob(pattern)), text
