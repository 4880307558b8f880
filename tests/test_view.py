"""The server of results: this machine, this user, this directory, reading only."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from contextlib import ExitStack, contextmanager, suppress
from http import HTTPStatus

import numpy as np
import pytest

from workbench.artefacts import Chapter, Scene
from workbench.errors import InputError, OutputError
from workbench.report import html
from workbench.server import HEADERS, LocalServer, said
from workbench.view import Results, address_of, result_server

SECRET = "not for the browser"


@pytest.fixture
def results(tmp_path):
    """A directory of results beside a file that must not be served."""
    (tmp_path / "secret.txt").write_text(SECRET)
    out = tmp_path / "out"
    (out / "part 1").mkdir(parents=True)
    (out / "report.html").write_text("<!doctype html><title>report</title>")
    (out / "inspection.json").write_text("{}")
    (out / "BevelPath.mod").write_text("MODULE")
    (out / "cloud.las").write_bytes(b"LASF")
    (out / ".partial-run").write_text(SECRET)
    (out / "<b>&.csv").write_text("a,b\n")
    (out / "part 1" / "report.html").write_text("one")
    return out


@pytest.fixture
def server(results):
    with result_server(results) as made, running(made):
        yield made


@contextmanager
def running(server):
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()


def ask(server, path, *, method="GET", host=None):
    """Status, headers (in any case) and body of one raw request: the path goes out as it is."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=120)
    connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
    host = f"127.0.0.1:{server.server_port}" if host is None else host
    if host:
        connection.putheader("Host", host)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, answer.headers, body


def test_the_report_opens_at_the_address(server, results):
    address = address_of(server, results)
    assert address.startswith(f"http://127.0.0.1:{server.server_port}/")
    assert address.endswith("/report.html")
    assert len(server.token) >= 32
    with urllib.request.urlopen(address) as answer:
        assert answer.read() == (results / "report.html").read_bytes()
        assert answer.headers["Content-Type"] == "text/html; charset=utf-8"


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("inspection.json", "application/json"),
        ("BevelPath.mod", "text/plain; charset=utf-8"),
        ("cloud.las", "application/octet-stream"),
        ("part%201/report.html", "text/html; charset=utf-8"),
        ("%3Cb%3E%26.csv", "text/csv; charset=utf-8"),
    ],
)
def test_files_come_as_what_they_are(server, name, kind):
    status, headers, body = ask(server, f"/{server.token}/{name}")
    assert (status, headers["Content-Type"], headers["Content-Length"]) == (200, kind, str(len(body)))
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    head = ask(server, f"/{server.token}/{name}", method="HEAD")
    assert (head[0], head[1]["Content-Length"], head[2]) == (200, str(len(body)), b"")


def test_without_the_token_nothing_is_told(server, results):
    with result_server(results) as other:
        assert other.token != server.token
    wrong = server.token[:-1] + ("A" if server.token[-1] != "A" else "B")
    others = [f"/{each}/report.html" for each in (wrong, server.token[:-1], f"{server.token}x", "")]
    for path in ("/", "/report.html", f"/{wrong}/nothing", "*", "/%20/../report.html", *others):
        status, _, body = ask(server, path)
        assert (status, body) == (403, b"forbidden\n"), path


def test_another_host_name_is_refused(server):
    port = server.server_port
    for host in (
        "evil.example",
        f"evil.example:{port}",
        "127.0.0.1",
        f"127.0.0.1:{port + 1}",
        f"127.0.0.1.evil:{port}",
        "",
    ):
        assert ask(server, f"/{server.token}/report.html", host=host)[0] in (400, 403), host
    assert ask(server, f"/{server.token}/report.html", host=f"localhost:{port}")[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "../secret.txt",
        "%2e%2e/secret.txt",
        "%2e%2e%2fsecret.txt",
        "..%5csecret.txt",
        "part%201/../../secret.txt",
        "part%201/%2e%2e/%2e%2e/secret.txt",
        "/etc/passwd",
        "//etc/passwd",
        "%2fetc%2fpasswd",
        ".partial-run",
        "report.html%00.txt",
        "nothing",
        "report.html/x",
        "./report.html",
        "way-out.txt",
        "way-out/secret.txt",
        "%ff%fe",
        "a" * 5000,
    ],
)
def test_nothing_outside_the_directory_is_served(server, results, path):
    (results / "way-out.txt").symlink_to(results.parent / "secret.txt")
    (results / "way-out").symlink_to(results.parent)
    status, _, body = ask(server, f"/{server.token}/{path}")
    assert status == 404
    assert SECRET.encode() not in body


def test_a_link_that_stays_inside_is_followed(server, results):
    (results / "latest.html").symlink_to(results / "part 1" / "report.html")
    assert ask(server, f"/{server.token}/latest.html")[2] == b"one"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without named pipes")
def test_a_pipe_is_not_waited_for(server, results):
    os.mkfifo(results / "pipe.json")
    assert ask(server, f"/{server.token}/pipe.json")[0] == 404


def test_the_listing_names_what_is_served(server, results):
    (results / "way-out.txt").symlink_to(results.parent / "secret.txt")
    status, headers, body = ask(server, f"/{server.token}/")
    assert status == 200
    assert headers["Content-Type"].startswith("text/html")
    assert b'<a href="part%201/">part 1/</a>' in body
    assert b"&lt;b&gt;&amp;.csv" in body
    assert b"<b>" not in body
    assert b"way-out" not in body
    assert b"partial" not in body
    status, headers, _ = ask(server, f"/{server.token}/part%201")
    assert (status, headers["Location"]) == (308, f"/{server.token}/part%201/")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "PROPFIND", "NONSENSE"])
def test_only_reading_and_the_same_headers_else(server, results, method):
    status, headers, _ = ask(server, f"/{server.token}/report.html", method=method)
    _, of_get, _ = ask(server, f"/{server.token}/report.html")
    assert status == 405
    assert {name: headers.get(name) for name in HEADERS} == {name: of_get[name] for name in HEADERS}
    assert (results / "report.html").exists()


def test_it_listens_on_this_machine_only(server):
    assert server.socket.getsockname()[0] == "127.0.0.1"
    with socket.socket() as other:
        other.settimeout(2)
        assert other.connect_ex(("127.0.0.2", server.server_port)) != 0


def test_what_cannot_be_served_is_refused(tmp_path, server):
    with pytest.raises(InputError, match="expected a directory"):
        result_server(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty"):
        result_server(tmp_path / "empty")
    with pytest.raises(OutputError, match="free port"):
        result_server(tmp_path, server.server_port)


@pytest.mark.skipif(sys.platform == "win32", reason="signals as POSIX has them")
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_the_command_prints_the_address_and_ends_with_ctrl_c(results, number, status):
    command = [sys.executable, "-m", "workbench", "view", str(results), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("view: http://127.0.0.1:")
        assert process.stdout.readline() == "Ctrl-C ends it\n"
        with urllib.request.urlopen(line.split()[1]) as answer:
            assert answer.status == 200
        process.send_signal(number)
        _, err = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == status
    assert "Traceback" not in err


def test_a_wrong_argument_is_one_line(command, tmp_path):
    for arguments, expected in (
        ((tmp_path / "nothing",), "expected a directory"),
        ((tmp_path, "--port", "99999"), "expected a port from 0 to 65535"),
        ((tmp_path, "--prot", "1"), "--port"),
    ):
        got = command("view", *arguments)
        assert got.status == 2
        assert expected in got.err
        assert len(got.err.splitlines()) == 1


def test_no_script_but_the_viewer_runs(server):
    """A page that somebody has put there may hold scripts; they are not run."""
    scene = Scene(np.eye(3), (), (), (), np.eye(3))
    page = html((Chapter("Plan", '<figure class="space"></figure>', scene=scene),)).content.decode()
    digest = hashlib.sha256(re.findall(r"<script>(.*?)</script>", page, re.DOTALL)[-1].encode()).digest()
    _, headers, _ = ask(server, f"/{server.token}/report.html")
    rules = dict(rule.strip().split(" ", 1) for rule in headers["Content-Security-Policy"].split(";"))
    assert rules["script-src"] == f"'sha256-{base64.b64encode(digest).decode()}'"
    assert "unsafe" not in rules["script-src"] + rules["default-src"]


def dripping(server, stack, count):
    """Connections that send a byte and then keep silent."""
    for _ in range(count):
        one = stack.enter_context(socket.create_connection(("127.0.0.1", server.server_port)))
        one.send(b"G")
        yield one


def test_neighbours_that_keep_silent_stop_nobody(server):
    with ExitStack() as stack:
        silent = [*dripping(server, stack, 1000)]
        assert len(silent) == 1000
        answers = []

        def one():
            answers.append(ask(server, f"/{server.token}/report.html")[0])

        threads = [threading.Thread(target=one) for _ in range(100)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert answers == [200] * 100


def test_who_does_not_say_what_it_wants_in_time_is_let_go(results):
    with LocalServer(Results(results), head_s=0.2) as server, running(server), ExitStack() as stack:
        for one in dripping(server, stack, 3):
            one.settimeout(120)
            assert one.recv(100) == b""
        until = time.monotonic() + 300
        while not served(server):  # on a loaded machine this test may itself be late
            assert time.monotonic() < until


def served(server):
    with suppress(OSError, IndexError, ValueError):
        return ask(server, f"/{server.token}/report.html")[0] == 200
    return False


def test_the_longest_silent_goes_where_there_are_too_many(results, monkeypatch):
    monkeypatch.setattr("workbench.server.MOST_CONNECTIONS", 8)
    with LocalServer(Results(results), head_s=1000) as server, running(server), ExitStack() as stack:
        first, *_ = dripping(server, stack, 9)
        first.settimeout(120)
        with suppress(ConnectionResetError):
            assert first.recv(100) == b""
        assert ask(server, f"/{server.token}/report.html")[0] == 200


def test_one_request_too_many_is_told_to_come_again():
    held = threading.Event()

    async def slow(scope, receive, send):
        while not held.is_set():
            await asyncio.sleep(0.001)
        await said(HTTPStatus.OK, "at last")(scope, receive, send)

    with LocalServer(slow, most_requests=2) as server, running(server):
        answers = []
        threads = [threading.Thread(target=lambda: answers.append(ask(server, f"/{server.token}/"))) for _ in "ab"]
        for thread in threads:
            thread.start()
        while server.at_work < 2:
            time.sleep(0.001)
        status, headers, _ = ask(server, f"/{server.token}/")
        assert (status, headers["retry-after"]) == (503, "1")
        held.set()
        for thread in threads:
            thread.join()
        assert [status for status, _, _ in answers] == [200, 200]


def test_what_is_no_request_gets_the_same_headers(server):
    with socket.create_connection(("127.0.0.1", server.server_port)) as one:
        one.sendall(b"\x16\x03\x01 no request\r\n\r\n")
        answer = b"".join(iter(lambda: one.recv(4096), b"")).decode()
    assert answer.startswith("HTTP/1.1 400 ")
    assert all(f"\r\n{name}: " in answer for name in HEADERS)
