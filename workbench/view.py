"""One directory of results in a browser: files inside it, for this machine's user alone (`workbench/server.py`)."""

from __future__ import annotations

import asyncio
import html
import os
import sys
import threading
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from urllib.parse import quote, unquote

from starlette.responses import FileResponse, RedirectResponse, Response
from starlette.types import Receive, Scope, Send

from workbench.errors import InputError
from workbench.report.html_stage import script_source, viewer_script
from workbench.server import LocalServer, said

# What of a directory may be served, and as what: regular files inside it, by plain names.

FIRST = ("report.html", "fleet.html")  # what a browser is sent to
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    **dict.fromkeys((".mod", ".src", ".dat", ".ls", ".txt", ".md", ".dxf"), "text/plain; charset=utf-8"),
}
MOST_NAMES = 10_000  # of a listing


class NotServedError(Exception):
    """No such file inside the directory, or none that may be served."""


def within(root: Path, address: str) -> Path:
    """The file or directory that a path in an address names.

    Args:
        root: the directory that is served, resolved.
        address: percent-encoded, without a leading slash; '' is the directory itself.

    Raises:
        NotServedError: hidden or climbing names, what does not exist, what lies outside of the directory.
    """
    parts = [unquote(part) for part in address.rstrip("/").split("/")] if address.rstrip("/") else []
    if any(not part or part.startswith(".") or set(part) & set("/\\:\0") for part in parts):
        raise NotServedError(address)
    try:
        found = root.joinpath(*parts).resolve(strict=True)
    except (OSError, RuntimeError, ValueError):
        raise NotServedError(address) from None
    if not found.is_relative_to(root):
        raise NotServedError(address)
    return found


def content_type(path: Path) -> str:
    """What a browser shall take a file for; what it does not know it stores."""
    return TYPES.get(path.suffix.lower(), "application/octet-stream")


def listing(root: Path, folder: Path) -> bytes:
    """A page with links to what may be served of a directory. Names are text only."""
    names = sorted(path.name + "/" * path.is_dir() for path in folder.iterdir() if _shown(root, path))[:MOST_NAMES]
    links = "\n".join(f'<li><a href="{quote(name)}">{html.escape(name)}</a></li>' for name in names)
    title = html.escape(folder.name)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title></head>\n'
        f"<body><h1>{title}</h1>\n<ul>\n{links}\n</ul></body></html>\n"
    ).encode(errors="backslashreplace")


def _shown(root: Path, path: Path) -> bool:
    try:
        found = within(root, quote(path.relative_to(root).as_posix()))
    except (NotServedError, UnicodeEncodeError):
        return False
    return found.is_dir() or found.is_file()


class Results:
    """The files of a directory, as an ASGI application.

    Raises:
        InputError: not a directory, or one without any file that is not meant to fill yet.
    """

    def __init__(self, directory: Path, *, may_be_empty: bool = False) -> None:
        if not directory.is_dir():
            raise InputError(str(directory), "expected a directory with the results of a run")
        self.root = directory.resolve()
        if not may_be_empty and not any(self.root.iterdir()):
            raise InputError(str(directory), "expected a directory with the results of a run, got an empty one")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """A file, or the listing of a directory."""
        answer = await asyncio.to_thread(self._answer, scope)
        await answer(scope, receive, send)

    def _answer(self, scope: Scope) -> Response:
        address = scope["raw_path"].decode("latin-1")  # still encoded: `within` refuses what decodes to a slash
        try:
            path = within(self.root, address.removeprefix("/"))
        except NotServedError:
            return said(HTTPStatus.NOT_FOUND, "not found\n")
        if path.is_file():
            return FileResponse(path, media_type=content_type(path))
        if not path.is_dir():  # a pipe or a device is not waited for
            return said(HTTPStatus.NOT_FOUND, "not found\n")
        if not address.endswith("/"):  # relative links start at the directory
            return RedirectResponse(f"{scope['root_path']}{address}/", HTTPStatus.PERMANENT_REDIRECT)
        return Response(listing(self.root, path), media_type="text/html; charset=utf-8")


def result_server(directory: Path, port: int = 0) -> LocalServer:
    """A server of a directory of results.

    Raises:
        InputError, OutputError: as Results, as LocalServer.
    """
    return LocalServer(Results(directory), port, script_source=script_source(viewer_script()))


def address_of(server: LocalServer, directory: Path) -> str:
    """Where a browser starts: the report, else the fleet's page, else the list of what is there."""
    first = next((name for name in FIRST if (directory / name).is_file()), "")
    return server.address + first


def serve(directory: Path, port: int, *, browser: bool, tell: Callable[[str], None]) -> None:
    """Serve until interrupted; `tell` gets the address.

    Raises:
        InputError, OutputError: as result_server.
        KeyboardInterrupt: somebody ended it.
    """
    with result_server(directory, port) as server:
        serve_at(server, address_of(server, directory), browser, tell)


def serve_at(server: LocalServer, address: str, browser: bool, tell: Callable[[str], None]) -> None:
    """Serve until interrupted; `tell` gets the address, and a browser opens it where one is wanted and can be seen."""
    tell(address)
    if browser and has_screen():
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
    server.serve_forever()


def has_screen() -> bool:
    """Whether a browser could show itself: in a terminal alone, one would take the terminal."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
