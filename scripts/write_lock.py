"""Print requirements.lock from pip's report of an installation: plain name==version lines, no address.

The one file serves every supported Python, so what others ask for on older Pythons only keeps that condition.
"""

import json
import re
import sys
import tomllib
from pathlib import Path


def main() -> None:
    """`write_lock.py REPORT.json`"""
    packages = [item["metadata"] for item in json.loads(Path(sys.argv[1]).read_text())["install"]]
    group = tomllib.loads(Path("pyproject.toml").read_text())["dependency-groups"]["dev"]
    asked = [line for package in packages for line in package.get("requires_dist", [])] + group
    conditions: dict[str, set[str]] = {}
    for line in asked:
        name, _, marker = line.partition(";")
        older = re.search(r"""python_(?:full_)?version < ['"](3\.\d+)['"]""", marker)
        condition = f" ; python_version < '{older[1]}'" if older and " or " not in marker else ""
        conditions.setdefault(plain(re.split(r"[^A-Za-z0-9._-]", name.strip())[0]), set()).add(condition)
    print("# Written by `make lock`; every version is tested together.")
    for name, version in sorted((plain(package["name"]), package["version"]) for package in packages):
        if name != "workbench":
            only = conditions.get(name, {""})
            print(f"{name}=={version}{min(only) if '' not in only else ''}")


def plain(name: str) -> str:
    """A package's name as the index normalises it."""
    return re.sub(r"[-_]+", "-", name).lower()


if __name__ == "__main__":
    main()
