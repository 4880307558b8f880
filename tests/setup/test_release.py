"""A release: one version everywhere, the same wheel from the same sources, a bill of what it is made of."""

from __future__ import annotations

import re
from pathlib import Path

from scripts.sbom import document
from workbench import __version__

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "requirements.lock").read_text()


def test_one_version_everywhere() -> None:
    assert re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1] == __version__  # type: ignore[index]
    assert f"\n## {__version__}, 20" in (ROOT / "CHANGELOG.md").read_text()


def test_the_bill_names_every_locked_package() -> None:
    made = document(LOCK)
    assert len(made["components"]) == len(re.findall(r"^[A-Za-z0-9._-]+==", LOCK, re.MULTILINE))
    by_name = {one["name"]: one for one in made["components"]}
    assert all(one["properties"] for one in made["components"])
    assert by_name["numpy"]["licenses"]
    assert made == document(LOCK)
