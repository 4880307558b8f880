"""A web server for one directory of results, for this machine's user alone.

It listens on the loopback interface only. Its address holds a random token, which other users of the machine and pages
from elsewhere do not know; a request must name this server as its host, so that a foreign name that is made to point
here (DNS rebinding) reads nothing. It answers GET and HEAD, and only with files inside the directory.
"""

from __future__ import annotations

import hmac
import html
import http.server
import os
import secrets
import shutil
import stat
import sys
import threading
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote, unquote, urlsplit

from workbench.errors import InputError, OutputError
from workbench.report.html import script_source, viewer_script

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


def opened(path: Path) -> tuple[BinaryIO, int]:
    """A regular file to read, and its size in bytes. A pipe or a device is not waited for."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    try:
        handle = os.open(path, flags)
    except OSError:
        raise NotServedError(str(path)) from None
    state = os.fstat(handle)
    if not stat.S_ISREG(state.st_mode):
        os.close(handle)
        raise NotServedError(str(path))
    return os.fdopen(handle, "rb"), state.st_size


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


LOOPBACK = "127.0.0.1"
TOKEN_BYTES = 24
MOST_REQUESTS = 32  # answered at a time: each holds a file open
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self' data:; style-src 'self' 'unsafe-inline'; connect-src 'none'; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; script-src ",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
}


class ResultServer(http.server.ThreadingHTTPServer):
    """Serves `directory` under `/token/`."""

    daemon_threads = True

    def __init__(self, directory: Path, port: int = 0) -> None:
        """`port` 0: any free one.

        Raises:
            InputError: not a directory, or one without any file.
            OutputError: the port cannot be had.
        """
        if not directory.is_dir():
            raise InputError(str(directory), "expected a directory with the results of a run")
        self.root = directory.resolve()
        if not any(self.root.iterdir()):
            raise InputError(str(directory), "expected a directory with the results of a run, got an empty one")
        self.token = secrets.token_urlsafe(TOKEN_BYTES)
        self.policy = HEADERS["Content-Security-Policy"] + script_source(viewer_script())
        self.room = threading.BoundedSemaphore(MOST_REQUESTS)
        try:
            super().__init__((LOOPBACK, port), Handler)
        except OSError as error:
            raise OutputError(f"--port {port}", f"expected a free port of {LOOPBACK}: {error.strerror}") from None

    def __repr__(self) -> str:
        """What it serves, without the token that opens it."""
        return f"ResultServer({str(self.root)!r}, port {self.server_port})"

    @property
    def hosts(self) -> set[str]:
        """What a request may call this server."""
        return {f"{name}:{self.server_port}" for name in (LOOPBACK, "localhost")}

    def process_request(self, request: Any, client_address: Any) -> None:
        """Wait until there is room."""
        self.room.acquire()
        super().process_request(request, client_address)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and make room."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.room.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """A browser that went away is no news; anything else is told in one line."""
        error = sys.exc_info()[1]
        if not isinstance(error, (ConnectionError, TimeoutError)):
            print(f"warning: a request was not answered: {error!r}", file=sys.stderr)


class Handler(http.server.BaseHTTPRequestHandler):
    """Answers one request."""

    server: ResultServer
    timeout = 30.0  # s without a word
    server_version, sys_version = "workbench", ""

    def do_GET(self) -> None:
        """A file, or the listing of a directory."""
        self._answer(send_body=True)

    def do_HEAD(self) -> None:
        """The same without its body."""
        self._answer(send_body=False)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """What is no request, or of a method that is not answered, gets the same headers as all else."""
        if code == HTTPStatus.NOT_IMPLEMENTED:
            self._send(HTTPStatus.METHOD_NOT_ALLOWED, "text/plain", b"GET and HEAD only\n", {"Allow": "GET, HEAD"})
        else:
            self._send(HTTPStatus(code), "text/plain", b"not a request\n")

    def _answer(self, *, send_body: bool) -> None:
        address = urlsplit(self.path).path
        token, _, inside = address.removeprefix("/").partition("/")
        known = hmac.compare_digest(token.encode(errors="replace"), self.server.token.encode())
        if not known or self.headers.get("Host", "").lower() not in self.server.hosts:
            return self._send(HTTPStatus.FORBIDDEN, "text/plain", b"forbidden\n" * send_body)
        try:
            path = within(self.server.root, inside)
            if not path.is_dir():
                return self._send_file(path, send_body)
        except NotServedError:
            return self._send(HTTPStatus.NOT_FOUND, "text/plain", b"not found\n" * send_body)
        if not address.endswith("/"):  # relative links start at the directory
            return self._send(HTTPStatus.PERMANENT_REDIRECT, "text/plain", b"", {"Location": address + "/"})
        page = listing(self.server.root, path)
        return self._send(HTTPStatus.OK, "text/html; charset=utf-8", page if send_body else b"", length=len(page))

    def _send_file(self, path: Path, send_body: bool) -> None:
        file, size = opened(path)
        with file:
            self._head(HTTPStatus.OK, content_type(path), size)
            if send_body:
                shutil.copyfileobj(file, self.wfile)

    def _send(
        self, status: HTTPStatus, kind: str, body: bytes, more: dict[str, str] | None = None, length: int | None = None
    ) -> None:
        self._head(status, kind, len(body) if length is None else length, more)
        self.wfile.write(body)

    def _head(self, status: HTTPStatus, kind: str, length: int, more: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(length),
            **HEADERS,
            **(more or {}),
            "Content-Security-Policy": self.server.policy,
        }.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not logged: their addresses hold the token."""


def address_of(server: ResultServer) -> str:
    """Where a browser starts: the report, else the fleet's page, else the list of what is there."""
    first = next((name for name in FIRST if (server.root / name).is_file()), "")
    return f"http://{LOOPBACK}:{server.server_port}/{server.token}/{first}"


def serve(directory: Path, port: int, *, browser: bool, tell: Callable[[str], None]) -> None:
    """Serve until interrupted; `tell` gets the address.

    Raises:
        InputError, OutputError: as ResultServer.
        KeyboardInterrupt: somebody ended it.
    """
    with ResultServer(directory, port) as server:
        address = address_of(server)
        tell(address)
        if browser and _has_screen():
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        server.serve_forever()


def _has_screen() -> bool:
    """Whether a browser could show itself: in a terminal alone, one would take the terminal."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
