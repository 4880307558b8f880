"""The digest of a package's sources: what was made with other ones is made anew."""

from __future__ import annotations

import functools
import hashlib
from importlib.util import find_spec
from pathlib import Path

SOURCES = (".py", ".j2", ".css", ".js")  # what a package's behaviour is written in


@functools.cache
def package_digest(name: str) -> str:
    """Of a package's source files, by name and content."""
    spec = find_spec(name)
    places = [Path(place) for place in (spec.submodule_search_locations or ())] if spec else []
    files = sorted((path for place in places for path in place.rglob("*") if path.suffix in SOURCES), key=str)
    if spec and spec.origin and not places:
        files, places = [Path(spec.origin)], [Path(spec.origin).parent]
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(next(p for p in places if p in path.parents))}\n".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
