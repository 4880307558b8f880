"""What the package's own text must not hold: ways to run what a file says, to listen, to call out."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import workbench
from scripts.ratchet import within

PACKAGE = Path(workbench.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "os.system", "os.popen", "input", "breakpoint"}
FORBIDDEN_MODULES = {
    "cPickle",
    "dill",
    "joblib",
    "cloudpickle",
    "marshal",
    "shelve",
    "code",
    "runpy",
    "imp",
    "telnetlib",
    "ftplib",
    "smtplib",
    "requests",
    "urllib3",
    "httpx",
    "aiohttp",
    "lxml",
    "yaml",
    "paramiko",
    "ssl",
}
MAY = {  # who may do what docs/security.md tells of
    "subprocess": {
        "batch/workers.py",
        "cad.py",
        "children.py",
        "compare/surface_stage.py",
        "page/jobs.py",
        "robot/urdf.py",
    },
    "multiprocessing": {"batch/workers.py"},
    "os.fork": {"pipeline/follow.py", "scan/hdf5.py"},
    "http.server": set(),
    "uvicorn": {"server.py"},
    "webbrowser": {"view.py"},
    "socket": {"server.py"},
    "urllib.request": set(),
    "fsspec": {"batch/store.py"},
    "distributed": {"batch/workers.py"},
    "importlib": {
        "__init__.py",
        "artefacts/showing.py",
        "children.py",
        "extras.py",
        "importing/kinds.py",
        "pipeline/catalogue.py",
        "pipeline/run.py",
        "stage.py",
        "user_folder.py",
    },
    "pickle": {"children.py", "kernels.py", "pipeline/cache.py"},
    "ctypes": set(),
    "xml.etree.ElementTree": {"certificate.py", "export/qif_stage.py", "robot/urdf.py"},
}


def place(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def dotted(node: ast.AST) -> str:
    """`a.b.c` of an expression, '' for others."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        head = dotted(node.value)
        return f"{head}.{node.attr}" if head else ""
    return ""


@cache
def nodes(text: str) -> list[ast.AST]:
    return list(within(ast.parse(text)))


def imported(text: str) -> Iterator[str]:
    for node in nodes(text):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom) and not node.level and node.module:
            yield node.module


def done(text: str) -> set[str]:
    """What a source imports or calls, by dotted names."""
    return {*imported(text), *(dotted(node.func) for node in nodes(text) if isinstance(node, ast.Call))}


def faults(text: str, name: str) -> list[str]:
    """What a source file does that it must not."""
    found = []
    for module in imported(text):
        top = module.partition(".")[0]
        if top in FORBIDDEN_MODULES:
            found.append(f"imports {module}")
    used = done(text)
    for what, allowed in MAY.items():
        if name not in allowed and any(one == what or one.startswith(f"{what}.") for one in used):
            found.append(f"uses {what}")
    for node in nodes(text):
        if not isinstance(node, ast.Call):
            continue
        call, words = dotted(node.func), {word.arg: word.value for word in node.keywords}
        if call in FORBIDDEN_CALLS:
            found.append(f"calls {call}")
        for word in ("shell", "allow_pickle"):
            if word in words and not (isinstance(words[word], ast.Constant) and words[word].value is False):
                found.append(f"calls {call} with {word}")
        if call.endswith("Environment") and "autoescape" not in words:
            found.append(f"calls {call} without autoescape")
    return found


def test_no_source_runs_what_files_say_nor_listens_nor_calls_out() -> None:
    found = {place(path): faults(path.read_text(encoding="utf-8"), place(path)) for path in SOURCES}
    assert len(found) > 300
    assert {name: what for name, what in found.items() if what} == {}


@pytest.mark.parametrize(
    "text",
    [
        "eval('1')",
        "import pickle",
        "from pickle import loads",
        "import os\nos.system('x')",
        "import subprocess",
        "import yaml",
        "f(x, shell=True)",
        "f(x, shell=flag)",
        "import numpy as np\nnp.load('a', allow_pickle=True)",
        "import socket",
        "import os\nos.fork()",
        "from http.server import HTTPServer",
        "import urllib.request",
        "from jinja2 import Environment\nEnvironment()",
        "import xml.etree.ElementTree as E",
    ],
)
def test_this_test_finds_what_it_looks_for(text: str) -> None:
    assert faults(text, "somewhere.py")


def test_every_name_in_the_list_is_in_the_package_and_needed() -> None:
    """An exception that nobody uses any more would be an open door."""
    used = {place(path): done(path.read_text(encoding="utf-8")) for path in SOURCES}
    for what, allowed in MAY.items():
        for name in allowed:
            assert any(one == what or one.startswith(f"{what}.") for one in used.get(name, ())), (what, name)


SAFE = {  # chapters, after `report.html.outside` has looked at them; the page's own style and script, out of its files
    "page.html.j2": {"{{ chapter.html | safe }}"},
    "frame.html.j2": {"{{ style | safe }}", "{{ script | safe }}"},
}


def test_templates_switch_no_escaping_off() -> None:
    for path in PACKAGE.rglob("*.j2"):
        text = path.read_text(encoding="utf-8")
        assert "autoescape false" not in text
        unescaped = set(re.findall(r"\{\{[^}]*\|\s*safe\b[^}]*\}\}", text))
        assert unescaped <= SAFE.get(path.name, set()), path
