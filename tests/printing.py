"""Pages as a browser prints them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any


def sheets(browser: Any, page: Path) -> int:
    """How many sheets of paper a page takes."""
    opened = browser.new_page()
    opened.set_default_timeout(300_000)  # a loaded machine draws slowly
    opened.goto(page.as_uri())
    printed = opened.pdf(prefer_css_page_size=True)
    opened.close()
    return len(re.findall(rb"/Type\s*/Page\b", printed))
