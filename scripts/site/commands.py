"""The commands on a page, run in order, and what the page says that they print.

A page is Markdown. Its blocks ```sh and, where asked for, ```python are run; a ```text block says what the block before
it printed: each of its lines, decimal numbers to within 0.02, `...` for what is left out.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"-?\d+\.\d+")
TOLERANCE = 0.02  # compilers differ in the last digits
Said = tuple[str, list[float]]


class PageError(Exception):
    """A command of a page fails, or prints something else than the page says."""


def blocks(page: str) -> list[tuple[str, str]]:
    """Language and text of the blocks of a page, in order."""
    return BLOCK.findall(page)


def lay_out(folder: Path) -> Path:
    """`folder` as a page finds the project, `.venv` being the environment that runs this."""
    for name in ("pipelines", "data", "docs/examples"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / ".venv").symlink_to(sys.prefix)
    return folder


def follow(
    page: str, folder: Path, languages: tuple[str, ...] = ("sh",), after: Callable[[str], None] = lambda command: None
) -> int:
    """Run the page's blocks in `folder` and compare; `after` is called with each block that was run. How many ran.

    Raises:
        PageError: a block fails, or did not print what the page says.
    """
    printed, ran = "", 0
    for language, text in blocks(page):
        if language in languages:
            printed, ran = run(language, text, folder), ran + 1
            after(text)
        elif language == "text":
            missing = [line for line in lines(text) if line[0] != "..." and not said(line, printed)]
            if missing:
                raise PageError(f"not printed: {missing}\nprinted:\n{printed}")
    return ran


def run(language: str, block: str, folder: Path) -> str:
    """What one block prints, standard output only."""
    command = ["sh", "-e", "-c", block] if language == "sh" else [sys.executable, "-c", block]
    env = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1"}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PageError(f"{block}\n{done.stdout}\n{done.stderr}")
    return done.stdout


def lines(text: str) -> list[Said]:
    """Each line as its words and its decimal numbers, spacing left out."""
    rows = [" ".join(line.split()) for line in text.splitlines() if line.strip()]
    return [(NUMBER.sub("#", row), [float(number) for number in NUMBER.findall(row)]) for row in rows]


def said(line: Said, printed: str) -> bool:
    """Whether a line was printed."""
    words, numbers = line
    return any(
        words == other and all(abs(a - b) <= TOLERANCE for a, b in zip(numbers, values, strict=True))
        for other, values in lines(printed)
    )
