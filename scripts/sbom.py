"""What the project is made of: a CycloneDX 1.5 document of every package of requirements.lock, on standard output.

    python -m scripts.sbom > sbom.json

Versions and hashes are the lock's; licences are what the installed packages say of themselves. The same lock and the
same packages give the same bytes.
"""

import hashlib
import json
import os
import re
import sys
import uuid
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Any

from workbench import __version__

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)")
HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")


def locked(text: str) -> list[tuple[str, str, list[str]]]:
    """(name, version, SHA-256 of its files) of each package of a lock."""
    found: list[tuple[str, str, list[str]]] = []
    for line in text.splitlines():
        if head := PACKAGE.match(line):
            found.append((head[1], head[2], []))
        found[-1][2].extend(HASH.findall(line)) if found else None
    return found


def licence(name: str) -> str | None:
    """What an installed package says of its licence; None where it is not installed or silent."""
    try:
        told = metadata(name)
    except PackageNotFoundError:
        return None
    classified = [one.rpartition(" :: ")[2] for one in told.get_all("Classifier", []) if one.startswith("License ::")]
    first_line = (told.get("License") or "").strip().split("\n")[0]
    return told.get("License-Expression") or ", ".join(classified) or first_line[:80] or None


def document(text: str) -> dict[str, Any]:
    """The CycloneDX document of a lock."""
    components = []
    for name, version, hashes in locked(text):
        purl = f"pkg:pypi/{name.lower().replace('_', '-')}@{version}"
        one: dict[str, Any] = {"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl}
        one["properties"] = [{"name": "lock:sha256", "value": digest} for digest in sorted(hashes)]
        if (told := licence(name)) is not None:
            one["licenses"] = [{"license": {"name": told}}]
        components.append(one)
    digest = hashlib.sha256(json.dumps([__version__, components], sort_keys=True).encode()).digest()
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{uuid.UUID(bytes=digest[:16], version=4)}",
        "version": 1,
        "metadata": {"component": {"type": "application", "name": "bevel-workbench", "version": __version__}},
        "components": components,
    }


def main() -> int:
    text = (ROOT / "requirements.lock").read_text()
    try:
        print(json.dumps(document(text), indent=1), flush=True)
    except BrokenPipeError:  # `| head`: whoever reads has enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's own flush at its end
    return 0


if __name__ == "__main__":
    sys.exit(main())
