"""The page as a browser would ask it."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from workbench.page.app import Page, page_server


class Client:
    """What a browser would send."""

    def __init__(self, page: Page) -> None:
        self.page, self.server = page, page_server(page)
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()
        self.root = f"/{self.server.token}"

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, str]:
        status, content = self._asked(method, path, body, headers)
        return status, content.decode()

    def content(self, path: str) -> bytes:
        return self._asked("GET", path, None, {})[1]

    def _asked(self, method: str, path: str, body: Any, headers: dict[str, str]) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.server_port, timeout=600)
        content = body if isinstance(body, bytes) else json.dumps(body).encode() if body is not None else None
        connection.request(method, self.root + path, content, headers)
        answer = connection.getresponse()
        told = answer.status, answer.read()
        connection.close()
        return told

    def json(self, method: str, path: str, body: Any = None) -> Any:
        status, text = self.ask(method, path, body)
        assert status == 200, text
        return json.loads(text)

    def done(self, number: int) -> Any:
        while (run := self.json("GET", f"/api/runs/{number}"))["state"] in ("queued", "running"):
            time.sleep(0.1)
        return run

    def close(self) -> None:
        self.server.shutdown()
        self.thread.join()
        self.server.socket.close()


@contextmanager
def opened(folder: Path) -> Iterator[Client]:
    """The folder's page, served until the end."""
    page = Page(folder)
    made = Client(page)
    try:
        yield made
    finally:
        made.close()
        page.close()
