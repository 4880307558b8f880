"""Sets of results in an output directory, and whether each is whole."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

RESULTS = ("inspection.json", "toolpath.json", "report.html")


def whole_sets(out: Path) -> dict[str, str] | None:
    """Digest of each set of results by its folder; {} where there is none, None where one is not whole.

    A set is whole if every file of its run.json is there and JSON is whole JSON; files without a run.json are no set,
    unless they have the name of a result.
    """
    found = {}
    for folder in (out, *(path for path in out.glob("*") if path.is_dir() and not path.name.startswith("."))):
        digest = digest_of(folder)
        if digest is None:
            return None
        if digest:
            found[folder.name] = digest
    return found


def digest_of(folder: Path) -> str | None:
    """Of all files that the folder's run.json names; '' without one, None where a file lacks or is cut short."""
    try:
        run = json.loads((folder / "run.json").read_bytes())
    except FileNotFoundError:
        return None if any((folder / name).exists() for name in RESULTS) else ""
    except ValueError:
        return None
    digest = hashlib.sha256()
    for name in run["files"]:
        try:
            content = (folder / name).read_bytes()
            if name.endswith(".json"):
                json.loads(content)
            elif name.endswith(".html") and not content.rstrip().endswith(b"</html>"):
                return None
        except (OSError, ValueError):
            return None
        digest.update(content)
    return digest.hexdigest()


def leftovers(out: Path) -> list[Path]:
    """Staged files that nobody will finish."""
    return [*out.parent.glob(f".{out.name}.*"), *out.rglob(".*partial*")]
