"""`python -m bench.neighbours`: what local processes that crowd or drip cost a user of `workbench view` and `open`.

The server runs in a process of its own. 32 connections say half a request and no more, 1,000 send a byte every half
second, 500 requests come at once; one user asks again and again meanwhile. Wall times, so the machine should be idle.
"""

from __future__ import annotations

import http.client
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from workbench.page.store import Store

SLOW, DRIPPING, PARALLEL, ASKED = 32, 1_000, 500, 40
DRIP_S = 0.5
RUNS = 200  # in the list that `open` shows


def main() -> None:
    """Print the waits of the user and of the crowd, without and with neighbours."""
    for name in ("view", "open"):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "report.html").write_text("<!doctype html><title>report</title>" + "x" * 200_000)
            if name == "open":
                with Store.of(Path(folder)) as store:
                    for k in range(RUNS):
                        store.add("inspect_bevel", {}, "done", part=f"P-{k}", verdict="pass", sizes={"root_mm": [1, 1]})
            with served(name, folder) as (port, path):
                measure(name, port, path)


def measure(name: str, port: int, path: str) -> None:
    """Ask without neighbours, then with each kind of them."""
    tell(f"{name}, alone", _user(port, path))
    with ExitStack() as held:
        for _ in range(SLOW):
            held.enter_context(socket.create_connection(("127.0.0.1", port))).send(b"GET / HTT")
        tell(f"{name}, beside {SLOW} slow connections", _user(port, path))
    ended = threading.Event()
    dripping = threading.Thread(target=_drip, args=(port, ended))
    dripping.start()
    time.sleep(8 * DRIP_S)
    tell(f"{name}, beside {DRIPPING} dripping connections", _user(port, path))
    with ThreadPoolExecutor(PARALLEL) as crowd:
        waits = [crowd.submit(_ask, port, path) for _ in range(PARALLEL)]
        tell(f"{name}, beside them and {PARALLEL} requests at once", _user(port, path))
        tell(f"{name}, those {PARALLEL}", [one.result() for one in waits])
    ended.set()
    dripping.join()


@contextmanager
def served(name: str, folder: str) -> Iterator[tuple[int, str]]:
    """Port and path of `workbench view` or `open` on a folder."""
    command = [sys.executable, "-m", "workbench", name, folder, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdout is not None
        try:
            address = urlsplit(server.stdout.readline().split()[1])
            yield int(address.port or 0), address.path
        finally:
            server.terminate()


def _ask(port: int, path: str) -> float:
    """How long a whole answer took, s; infinite if it was none."""
    begin = time.monotonic()
    try:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        connection.request("GET", path)
        answer = connection.getresponse()
        whole = answer.status == 200 and answer.read().endswith((b"xxx", b"</html>"))
    except (OSError, http.client.HTTPException):
        return float("inf")
    return time.monotonic() - begin if whole else float("inf")


def _user(port: int, path: str) -> list[float]:
    return [_ask(port, path) for _ in range(ASKED)]


def _drip(port: int, ended: threading.Event) -> None:
    """A byte every DRIP_S from each connection; who is let go comes again."""
    held: list[socket.socket] = []
    while not ended.wait(DRIP_S):
        for one in [*held]:
            try:
                one.send(b"G")
            except OSError:
                one.close()
                held.remove(one)
        while len(held) < DRIPPING:
            held.append(socket.create_connection(("127.0.0.1", port)))
    for one in held:
        one.close()


def tell(what: str, waits: list[float]) -> None:
    """Print the median and the longest of some waits, s."""
    none = sum(wait == float("inf") for wait in waits)
    print(
        f"{what}: median {statistics.median(waits):.3f} s, longest {max(waits):.3f} s, not answered {none}", flush=True
    )


if __name__ == "__main__":
    main()
