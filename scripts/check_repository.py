"""Refuse what must not stand in the repository: hosts of package registries, paths of a machine, links, large files."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MADE_BY_TOOLS = {".git", ".venv", "out", "build", "__pycache__"} | {
    f".{tool}" for tool in ("mypy_cache", "ruff_cache", "pytest_cache", "hypothesis", "import_linter_cache")
}
LARGEST_BYTES = 4 * 2**20
# Letters in brackets, so that this file passes its own check.
FORBIDDEN = {
    "host of a package registry": re.compile(r"[p]ypi\.org|[p]ythonhosted|registry\.[n]pmjs|deb\.[d]ebian|[i]ndex-url"),
    "path of one machine": re.compile(r"(?<![\w.:/-])/([h]ome|[r]oot|[w]ork|[U]sers)/\w"),
    "mark against the formatter": re.compile(r"# [f]mt: "),
}


def files() -> list[Path]:
    """What git tracks, or where there is no git every file that is not made by a tool."""
    if shutil.which("git"):
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
        if listed.returncode == 0 and listed.stdout:
            return [ROOT / name for name in listed.stdout.split("\0") if name]
    return [path for path in ROOT.rglob("*") if not MADE_BY_TOOLS.intersection(path.relative_to(ROOT).parts)]


def findings(path: Path) -> list[str]:
    """What is wrong with one file, one line each."""
    name = path.relative_to(ROOT)
    if path.is_symlink():
        return [f"{name}: a symbolic link"]
    size = path.stat().st_size
    if size > LARGEST_BYTES:
        return [f"{name}: {size} bytes, at most {LARGEST_BYTES}"]
    content = path.read_bytes()
    if b"\0" in content:
        return []
    return [
        f"{name}:{number}: {what}"
        for number, line in enumerate(content.decode(errors="replace").splitlines(), 1)
        for what, pattern in FORBIDDEN.items()
        if pattern.search(line)
    ]


def main() -> int:
    found = [finding for path in files() if path.is_file() or path.is_symlink() for finding in findings(path)]
    print("\n".join(found) if found else "repository: nothing that must not stand here")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
