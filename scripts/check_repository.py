"""Refuse what must not stand in the repository.

That is hosts of package registries, paths of a machine, links, large files, functions of many parameters, and a size
that rose (`ratchet.py`): `--write` writes down what fell, `--because WHY` what rose as well.
"""

import argparse
import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import ratchet

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
MOST_PARAMETERS = 8
EXEMPT = ("stage",)  # takes what its documentation lists
LONG_KERNELS = {  # files whose kernels still take their arrays one by one
    "workbench/geometry/end_face.py",
    "workbench/geometry/outliers.py",
    "workbench/geometry/penalised.py",
    "workbench/geometry/stations.py",
    "workbench/geometry/tracking.py",
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
    text = content.decode(errors="replace")
    found = [
        f"{name}:{number}: {what}"
        for number, line in enumerate(text.splitlines(), 1)
        for what, pattern in FORBIDDEN.items()
        if pattern.search(line)
    ]
    if path.suffix == ".py":
        found += [f"{name}:{one}" for one in many_parameters(text, name.as_posix())]
    return found


def many_parameters(text: str, name: str) -> list[str]:
    """Functions that take more than MOST_PARAMETERS, self aside, one line each."""
    found = []
    for one in ast.walk(ast.parse(text)):
        if not isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        decorators = [call.func if isinstance(call, ast.Call) else call for call in one.decorator_list]
        exempt = (*EXEMPT, "kernel") if name in LONG_KERNELS else EXEMPT
        if any(isinstance(each, ast.Name) and each.id in exempt for each in decorators):
            continue
        taken = [each.arg for each in (*one.args.posonlyargs, *one.args.args, *one.args.kwonlyargs)]
        count = len(taken) - (taken[:1] in (["self"], ["cls"]))
        if count > MOST_PARAMETERS:
            found.append(f"{one.lineno}: {one.name} takes {count} parameters, at most {MOST_PARAMETERS}")
    return found


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Refuse what must not stand in the repository.")
    parser.add_argument("--write", action="store_true", help="write down in scripts/ratchet.txt what fell")
    parser.add_argument("--because", metavar="WHY", default="", help="write down too what rose, and why")
    parser.add_argument(
        "--loaded", action="store_true", help="measure too what a verdict and a program load (a minute)"
    )
    asked = parser.parse_args(arguments)
    now = ratchet.measured(asked.loaded)
    if asked.write or asked.because:
        ratchet.write(now, asked.because)
    found = [finding for path in files() if path.is_file() or path.is_symlink() for finding in findings(path)]
    found += ratchet.findings(now)
    print("\n".join(found) if found else "repository: nothing that must not stand here")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
