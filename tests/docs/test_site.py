"""The site: built without a warning, each link leads somewhere, nothing is fetched, every page is in its contents."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest

from scripts.site import ages
from scripts.site.__main__ import main
from scripts.site.commands import ROOT, lay_out
from scripts.site.gallery import hang

LOADED = {("img", "src"), ("script", "src"), ("link", "href"), ("iframe", "src"), ("source", "src")}


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.loaded, self.linked, self.anchors = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if (tag, name) in LOADED:
                self.loaded.append(value)
            elif (tag, name) == ("a", "href"):
                self.linked.append(value)
            elif name == "id":
                self.anchors.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "scripts.site", "--quick", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def pages(site):
    return {path: Page(path.read_text()) for path in site.rglob("*.html")}


def test_every_link_leads_to_a_place_in_the_site(pages):
    dead = []
    for path, page in pages.items():
        for address in page.linked + page.loaded:
            parts = urlsplit(address)
            if parts.scheme == "https":
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = target.exists() and (
                not parts.fragment or target.suffix != ".html" or unquote(parts.fragment) in pages[target].anchors
            )
            dead += [] if known else [f"{path.name}: {address}"]
    assert dead == []


def test_nothing_is_fetched_from_elsewhere(site, pages):
    assert [one for page in pages.values() for one in page.loaded if urlsplit(one).scheme not in ("", "data")] == []
    styles = "".join(path.read_text() for path in site.rglob("*.css"))
    assert re.findall(r"(?:url\(|@import)[^;]*//[^;]*", styles) == []


def test_every_page_of_the_project_is_in_the_site_and_its_contents(site, pages):
    reached, waiting = set(), [site / "index.html"]
    while waiting:
        path = waiting.pop()
        if path in reached or path not in pages:
            continue
        reached.add(path)
        waiting += [(path.parent / unquote(urlsplit(one).path)).resolve() for one in pages[path].linked]
    sources = [*(ROOT / "docs").rglob("*.md"), *(ROOT / f"{name}.md" for name in ("CHANGELOG", "CONTRIBUTING"))]
    assert {site / path.relative_to(ROOT).with_suffix(".html") for path in sources} - reached == set()


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path, capsys, monkeypatch):
    (tmp_path / "thesis.txt").write_text("mine")
    monkeypatch.setattr(sys, "argv", ["site", "--quick", str(tmp_path)])
    assert main() == 1
    assert "expected an empty folder" in capsys.readouterr().err
    assert (tmp_path / "thesis.txt").read_text() == "mine"


@pytest.mark.slow
def test_the_gallery_finds_its_pictures_in_the_reports(tmp_path):
    page = tmp_path / "README.md"
    page.write_text((ROOT / "docs/gallery/README.md").read_text())
    assert hang(page, lay_out(tmp_path / "project")) >= 15


def test_a_table_older_than_its_code_is_marked(tmp_path):
    def commit(*words):
        asked = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
        return asked.stdout.split()[0] if asked.stdout else pytest.skip("needs the history in git")

    first, last = commit("rev-list", "--max-parents=0", "HEAD"), commit("rev-parse", "HEAD")
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    command = "`python -m bench.programs --count 3`"
    page.write_text(f"{command}, commit {first}\n\n{command}, commit {last}\n\n{command}\n\n| 1 |\n", encoding="utf-8")
    found = ages.mark(tmp_path)
    lines = page.read_text(encoding="utf-8").splitlines()
    assert re.search(r"older than its code by \d+ commit", lines[0])
    assert lines[2].endswith(last)
    assert lines[4].endswith("*(states no commit)*")
    assert [one.split(":")[1] for one in found] == ["1", "5"]
    assert {"bench/programs.py", "workbench/program", "workbench/robot"} <= ages.code_of("bench.programs")
