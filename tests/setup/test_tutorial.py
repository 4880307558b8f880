"""The tutorial works as written: every shell and Python block runs, in order, and says what the page says it says."""

import pytest

from scripts.site.commands import ROOT, PageError, follow, lay_out

PRINTING = "```sh\necho '0.514 mm'\necho more\n```\n```text\n{}\n```\n"


def test_every_block_of_the_tutorial_runs_and_prints_what_it_says(tmp_path):
    page = (ROOT / "docs/tutorial.md").read_text()
    assert follow(page, lay_out(tmp_path), ("sh", "python")) >= 6


@pytest.mark.parametrize("says", ["0.52   mm", "...\nmore"])
def test_what_is_printed_counts_to_two_hundredths(tmp_path, says):
    assert follow(PRINTING.format(says), tmp_path) == 1


@pytest.mark.parametrize("says", ["0.54 mm", "0.514 m", "much more"])
def test_a_page_that_says_what_is_not_printed_is_found(tmp_path, says):
    with pytest.raises(PageError, match="not printed"):
        follow(PRINTING.format(says), tmp_path)
