"""Tables that are older than the code they speak of: marked in the site's pages, listed when it is built.

A table's code is the module of `bench/` that its command names, what that imports of `bench/`, and the rooms of the
package that these import. Its age is the commit that stands beside the command.
"""

from __future__ import annotations

import ast
import functools
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMMAND = re.compile(r"(?:^|^\| |^- |\()`python -m (bench[.\w]+)[^`]*`(?=$|[:;,)]| \(| \|)")  # not within a sentence
COMMIT = re.compile(r"commit ([0-9a-f]{7,40})\b")
NEAR = 7  # lines from a command to its table, a heading between them
RESULTS = re.compile(r"^\||^In all rows|\[[^\]]*\]\(tables/[^)]*\.csv\)")  # what makes lines below a command a table


def mark(source: Path) -> list[str]:
    """Mark the pages under `source`; what is older than its code, or states no commit, one line each."""
    found = []
    for page in sorted((source / "docs").rglob("*.md")):
        lines = page.read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines):
            command, stated = COMMAND.search(line), COMMIT.search(line)
            if command is None or not (stated or any(RESULTS.search(one) for one in lines[number : number + NEAR])):
                continue
            age = since(stated[1], command[1]) if stated else "states no commit"
            if age and not line.startswith("|"):
                lines[number] = f"{line} *({age})*"
            if age:
                found.append(f"{page.relative_to(source)}:{number + 1}: {command[1]}: {age}")
        page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return found


def since(commit: str, module: str) -> str:
    """How much younger than `commit` the code is that `module` runs; empty: not at all, or there is no git to ask."""
    told = ("git", "log", "--format=%h", f"{commit}..HEAD", "--", *sorted(code_of(module)))
    try:
        asked = subprocess.run(told, cwd=ROOT, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return ""
    if asked.returncode:
        return f"commit {commit} is not in this history"
    count = len(asked.stdout.split())
    return f"older than its code by {count} commit{'s' * (count > 1)}" if count else ""


def code_of(module: str) -> set[str]:
    """Paths of the modules of `bench` that `module` rests on, and of the rooms of the package that these import."""
    seen: set[str] = set()
    waiting = [module]
    while waiting:
        parts = waiting.pop().split(".")
        if parts[0] == "workbench" and len(parts) > 1:
            room = "/".join(parts[: 3 if parts[1] == "plugins" else 2])
            seen.add(room if (ROOT / room).is_dir() else f"{room}.py")
        if parts[0] != "bench" or len(parts) < 2:
            continue
        place = ROOT.joinpath(*parts)
        files = [*place.rglob("*.py")] if place.is_dir() else [place.with_suffix(".py")]
        for file in files:
            name = file.relative_to(ROOT).as_posix()
            if name not in seen and file.is_file():
                seen.add(name)
                waiting += imported(file)
    return seen


@functools.cache
def imported(file: Path) -> list[str]:
    """Modules, and names of modules that may be modules themselves, that a file imports anywhere."""
    found = []
    for one in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(one, ast.Import):
            found += [each.name for each in one.names]
        if isinstance(one, ast.ImportFrom) and one.module:
            found += [one.module, *(f"{one.module}.{each.name}" for each in one.names)]
    return found
