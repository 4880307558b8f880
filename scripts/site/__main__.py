"""Build the site of the documentation into a folder, out/docs by default: `python -m scripts.site [--quick] [FOLDER]`.

`--quick` leaves out what runs pipelines: the tutorial, the how-tos and the gallery's pictures.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from scripts.site import ages, navigation
from scripts.site.commands import ROOT, PageError, follow, lay_out
from scripts.site.gallery import hang

HERE = Path(__file__).parent
TOP = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")
LINK = re.compile(r"\]\(([^)#\s]+)")
GALLERY = "docs/gallery/README.md"


def build(target: Path, quick: bool) -> None:
    """Copy the pages, run what they tell to run, add navigation, write HTML.

    Raises:
        PageError: a page's command fails, or it says what is not so; Sphinx warns; `target` holds something else.
    """
    if not replaceable(target):
        raise PageError(f"{target}: expected an empty folder, or a site made earlier")
    with tempfile.TemporaryDirectory() as folder:
        source = copy_pages(Path(folder) / "source")
        if not quick:
            run_pages(source, lay_out(Path(folder) / "project"))
        print("\n".join(ages.mark(source)))
        navigation.add(source)
        write_html(source, target)


def copy_pages(source: Path) -> Path:
    """The pages, and all that they link to in this repository, laid out as they are there."""
    ignored = shutil.ignore_patterns("__pycache__", ".*")
    shutil.copytree(ROOT / "docs", source / "docs", ignore=ignored)
    waiting = [source / "docs" / path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")]
    for name in TOP:
        waiting.append(_copied(ROOT / name, source))
    while waiting:
        page = waiting.pop()
        for target in LINK.findall(page.read_text()):
            original = (ROOT / page.relative_to(source).parent / target).resolve()
            if not original.is_relative_to(ROOT) or not original.is_file():
                continue  # an address, or a link whose absence Sphinx reports
            if not (source / original.relative_to(ROOT)).exists():
                copied = _copied(original, source)
                waiting += [copied] if copied.suffix == ".md" else []
    return source


def _copied(original: Path, source: Path) -> Path:
    copied = source / original.relative_to(ROOT)
    copied.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(original, copied)
    return copied


def run_pages(source: Path, project: Path) -> None:
    """The tutorial, the how-tos and the gallery, each from the beginning of the page."""
    pages = [("docs/tutorial.md", ("sh", "python"))]
    pages += [(f"docs/howto/{path.name}", ("sh",)) for path in sorted((source / "docs/howto").glob("*.md"))]
    for name, languages in pages:
        start = time.perf_counter()
        try:
            follow((source / name).read_text(), project, languages)
        except PageError as error:
            raise PageError(f"{name}: {error}") from None
        print(f"{name}: as it says, {time.perf_counter() - start:.0f} s", flush=True)
    start = time.perf_counter()
    print(f"{GALLERY}: {hang(source / GALLERY, project)} pictures, {time.perf_counter() - start:.0f} s", flush=True)


def write_html(source: Path, target: Path) -> None:
    """Sphinx, warnings as errors; the start page is index.html as well. `target` keeps what it has if that fails."""
    made = source.parent / "html"
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-c", str(HERE)]
    done = subprocess.run([*command, "-d", str(source.parent / "doctrees"), str(source), str(made)], check=False)
    if done.returncode:
        raise PageError("Sphinx says above what is wrong with the pages")
    shutil.copyfile(made / "README.html", made / "index.html")
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(made, target)


def replaceable(target: Path) -> bool:
    """Whether `target` is empty, or a site that this made earlier."""
    return not target.exists() or not any(target.iterdir()) or (target / "searchindex.js").exists()


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="build the documentation's site")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "out/docs")
    parser.add_argument("--quick", action="store_true", help="leave out what runs pipelines")
    given = parser.parse_args()
    try:
        build(given.folder.resolve(), given.quick)
    except PageError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"site: {given.folder / 'index.html'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
