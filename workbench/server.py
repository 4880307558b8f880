"""A web server for this machine's user alone, and one that neighbours cannot stop.

It listens on the loopback interface only. Its address holds a random token, which other users of the machine and pages
from elsewhere do not know; a request must name this server as its host, so that a foreign name that is made to point
here (DNS rebinding) reads nothing. A connection has HEAD_S to say what it wants and ANSWER_S in all; where there are
too many, the one that has kept silent longest goes, and a request beyond MOST_REQUESTS is told to come again (503).
"""

from __future__ import annotations

import asyncio
import functools
import hmac
import logging
import os
import secrets
import socket
import sys
import threading
from http import HTTPStatus
from types import TracebackType
from typing import Any
from urllib.parse import unquote

import uvicorn
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from workbench.errors import OutputError

LOOPBACK = "127.0.0.1"
TOKEN_BYTES = 24
HEAD_S, ANSWER_S = 10.0, 60.0
MOST_CONNECTIONS, MOST_REQUESTS, BACKLOG = 2_000, 600, 1_024
READING = ("GET", "HEAD")
HEADERS = {
    "Cache-Control": "no-store",
    "Connection": "close",
    "Content-Security-Policy": "default-src 'self' data:; style-src 'self' 'unsafe-inline'; connect-src 'none'; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; script-src ",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "X-Content-Type-Options": "nosniff",
}


class LocalServer:
    """Serves `app` (ASGI) under `/token/`, which becomes its `root_path`; paths begin with the slash after it.

    Args:
        app: answers what it `takes`.
        port: 0 is any free one.
        script_source: which scripts of its pages may run, as a content security policy says it.
        head_s: what a connection has to say what it wants.
        most_requests: answered at a time.
        takes: methods. Where it takes more than reading, its own pages, and they alone, may send to it.

    Raises:
        OutputError: the port cannot be had.
    """

    def __init__(
        self,
        app: ASGIApp,
        port: int = 0,
        *,
        script_source: str = "'none'",
        head_s: float = HEAD_S,
        most_requests: int = MOST_REQUESTS,
        takes: tuple[str, ...] = READING,
    ) -> None:
        self.token = secrets.token_urlsafe(TOKEN_BYTES)
        self.socket = socket.socket()
        try:
            if os.name == "posix":
                self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self.socket.bind((LOOPBACK, port))
            self.socket.listen(BACKLOG)
        except OSError as error:
            self.socket.close()
            raise OutputError(f"--port {port}", f"expected a free port of {LOOPBACK}: {error.strerror}") from None
        self.server_port: int = self.socket.getsockname()[1]
        policy = HEADERS["Content-Security-Policy"] + script_source
        if takes != READING:
            for what in ("connect-src", "form-action", "frame-ancestors"):
                policy = policy.replace(f"{what} 'none'", f"{what} 'self'")
        self.headers, self.takes = {**HEADERS, "Content-Security-Policy": policy}, takes
        self.most_requests, self.at_work = most_requests, 0
        self.app = app
        logging.getLogger("uvicorn").setLevel(logging.CRITICAL + 1)  # requests are not logged: addresses hold the token
        config = uvicorn.Config(
            self._answer,
            http=functools.partial(BoundedConnection, head_s, self.headers),  # type: ignore[arg-type]
            ws="none",
            interface="asgi3",
            proxy_headers=False,
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            backlog=BACKLOG,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._stopped = threading.Event()

    @property
    def address(self) -> str:
        """Of what it serves, with the token."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.token}/"

    def __repr__(self) -> str:
        """What it is, without the token that opens it."""
        return f"LocalServer(port {self.server_port})"

    def __enter__(self) -> LocalServer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.socket.close()

    def serve_forever(self) -> None:
        """Answer until `shutdown` in another thread; or until SIGINT or SIGTERM, which are then as without a server."""
        try:
            asyncio.run(self._server.serve(sockets=[self.socket]))
        finally:
            self._stopped.set()

    def shutdown(self) -> None:
        """Let `serve_forever` end; returns when it has."""
        self._server.should_exit = True
        self._stopped.wait()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Whatever the app does, with this server's headers; nothing without token and host."""
        begun = False

        async def framed(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                own = {name.lower().encode() for name in self.headers}
                kept = [(name, value) for name, value in message["headers"] if name.lower() not in own]
                message = {**message, "headers": kept + _encoded(self.headers)}
            await send(message)

        answer: ASGIApp = self._refusal(scope) or self.app
        if self.at_work >= self.most_requests:
            answer = said(HTTPStatus.SERVICE_UNAVAILABLE, "too many requests at a time\n", {"Retry-After": "1"})
        self.at_work += 1
        try:
            await answer(scope, receive, framed)
        except Exception as error:
            print(f"warning: a request was not answered: {error!r}", file=sys.stderr)
            if not begun:
                await said(HTTPStatus.INTERNAL_SERVER_ERROR, "not answered\n")(scope, receive, framed)
        finally:
            self.at_work -= 1

    def _refusal(self, scope: Scope) -> Response | None:
        """Why a request gets nothing; else the token is taken off its path."""
        if scope["method"] not in self.takes:
            only = ", ".join(self.takes)
            return said(HTTPStatus.METHOD_NOT_ALLOWED, f"{only} only\n", {"Allow": only})
        token, slash, inside = scope["raw_path"].removeprefix(b"/").partition(b"/")
        named = [value for name, value in scope["headers"] if name == b"host"]
        hosts = [f"{name}:{self.server_port}".encode() for name in (LOOPBACK, "localhost")]
        known = hmac.compare_digest(token, self.token.encode())
        origins = [value for name, value in scope["headers"] if name == b"origin"]
        own = all(origin.removeprefix(b"http://") in hosts for origin in origins)
        if not known or len(named) != 1 or named[0].lower() not in hosts or not own:
            return said(HTTPStatus.FORBIDDEN, "forbidden\n")
        scope["root_path"], scope["raw_path"] = f"/{self.token}", slash + inside
        scope["path"] = unquote(scope["raw_path"].decode("latin-1"))
        return None


def said(status: HTTPStatus, text: str, headers: dict[str, str] | None = None) -> Response:
    """A short answer."""
    return Response(text, status, headers, "text/plain")


def _encoded(headers: dict[str, str]) -> list[tuple[bytes, bytes]]:
    return [(name.lower().encode(), value.encode()) for name, value in headers.items()]


class BoundedConnection(H11Protocol):
    """One request, in a bounded time."""

    def __init__(self, head_s: float, headers: dict[str, str], **more: Any) -> None:
        super().__init__(**more)
        self.head_s, self.frame = head_s, headers
        self.timers: list[asyncio.TimerHandle] = []

    def connection_made(self, transport: Any) -> None:
        """Time runs; where too many are open, the one that has kept silent longest goes."""
        super().connection_made(transport)
        if len(self.connections) > most_connections():
            silent = [one for one in self.connections if isinstance(one, BoundedConnection) and not one.cycle]
            min(silent, key=BoundedConnection.begun).transport.abort()
        self.timers = [
            self.loop.call_later(self.head_s, self._end_if_silent),
            self.loop.call_later(ANSWER_S, transport.abort),
        ]

    def begun(self) -> float:
        """When, on the loop's clock; this one, whose time does not run yet, last."""
        return self.timers[0].when() if self.timers else float("inf")

    def connection_lost(self, exc: Exception | None) -> None:
        """Its time need not run on."""
        for timer in self.timers:
            timer.cancel()
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        """What is no request gets the same headers as all else."""
        lines = [f"{name}: {value}\r\n" for name, value in self.frame.items()]
        self.transport.write(f"HTTP/1.1 400 Bad Request\r\n{''.join(lines)}\r\nnot a request\n".encode())
        self.transport.close()

    def _end_if_silent(self) -> None:
        if not self.cycle:
            self.transport.abort()


def most_connections() -> int:
    """Fewer where the system lets this process open fewer files: each may come to hold two."""
    try:
        import resource
    except ImportError:
        return MOST_CONNECTIONS
    return min(MOST_CONNECTIONS, max(32, (resource.getrlimit(resource.RLIMIT_NOFILE)[0] - 100) * 2 // 3))
