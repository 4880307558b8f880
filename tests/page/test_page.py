"""The workbench's page: a folder, its runs and its files, for this machine's user alone."""

from __future__ import annotations

import errno
import json
import os
import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.page.conftest import Client, opened
from tests.pipeline.test_follow import writing
from workbench.errors import InputError
from workbench.page.app import Page
from workbench.page.forms import fields_of
from workbench.page.store import Preset, Store
from workbench.samples import pipelines, shipped_pipeline

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "data" / "synthetic" / "milled_edge.h5"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "shop"
    made.mkdir()
    shutil.copy(SAMPLE, made / "part-7.h5")
    return made


@pytest.fixture
def client(folder: Path) -> Iterator[Client]:
    with opened(folder) as made:
        yield made


def test_a_part_from_the_file_to_the_verdict_and_back(client: Client, folder: Path) -> None:
    """Upload, form, run, page, report, what changed; the results are those of `workbench run`."""
    made = client.json("PUT", "/api/files/part-7.h5", SAMPLE.read_bytes())
    assert made["file"] == "part-7-2.h5"  # never in the place of another
    assert (folder / made["file"]).read_bytes() == SAMPLE.read_bytes()
    status, form = client.ask("GET", "/new?pipeline=inspect_bevel&file=part-7-2.h5")
    assert status == 200
    assert "<option selected>part-7-2.h5</option>" in form
    inputs = {"recording": "part-7-2.h5", "part_id": "P-7"}
    first = client.done(client.json("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": inputs})["id"])
    assert (first["state"], first["verdict"], first["part"]) == ("done", "pass", "P-7")
    results = folder / "results" / str(first["id"])
    tree = json.loads((results / "inspection.json").read_text())
    assert first["sizes"]["root_mm"][1] == pytest.approx(2.0 * max(one["root_u_mm"] for one in tree["sections"]))
    inputs["root_tolerance_mm"] = [-0.15, 0.0]
    while not client.page.queue.waits:  # so that the second run is that child's
        time.sleep(0.05)
    second = client.done(client.json("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": inputs})["id"])
    assert second["verdict"] == "fail", second
    page = client.ask("GET", f"/runs/{second['id']}")[1]
    assert "FAIL" in page
    assert "[-0.15, 0.0]" in page  # what changed since the last run
    assert client.ask("GET", f"/results/{second['id']}/report.html")[0] == 200
    shop = client.ask("GET", "/")[1]
    assert shop.index("FAIL") < shop.index("PASS")
    assert "P-7" in client.ask("GET", "/?part=p-7")[1]
    assert '<td class="name">P-7' not in client.ask("GET", "/?part=other")[1]


def test_a_look_and_a_run_that_cannot_be(client: Client, folder: Path) -> None:
    (folder / "half.h5").write_bytes(SAMPLE.read_bytes()[:10_000])
    look = client.done(client.json("POST", "/api/runs", {"look": "half.h5"})["id"])
    assert look["state"] == "failed"
    assert "half.h5" in look["reason"]
    assert "\n" not in look["reason"]
    assert "<h1>half.h5</h1>" in client.ask("GET", f"/runs/{look['id']}")[1]
    assert look["reason"].split(":")[0].endswith("half.h5") or "half.h5" in client.ask("GET", f"/runs/{look['id']}")[1]


def test_runs_that_wait_or_are_at_work_are_cancelled(client: Client, folder: Path) -> None:
    """The first waits for the end of its recording."""
    with writing(folder / "endless.h5", last=24, alive=True):
        inputs = {"recording": "endless.h5"}
        first = client.json("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": inputs})["id"]
        many = [first, *(client.json("POST", "/api/runs", {"look": "part-7.h5"})["id"] for _ in range(2))]
        while client.json("GET", f"/api/runs/{first}")["state"] != "running":
            time.sleep(0.02)
        for number in reversed(many):
            client.json("POST", f"/api/runs/{number}/cancel", {})
        assert {client.done(number)["state"] for number in many} == {"cancelled"}


@pytest.mark.parametrize(
    ("method", "path", "body", "words"),
    [
        ("POST", "/api/runs", {"pipeline": "inspect_bevle", "inputs": {}}, "expected one of inspect_bevel"),
        ("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": {"recroding": 1}}, "no such input"),
        ("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": {"recording": "../x.h5"}}, "expected a file in"),
        ("POST", "/api/runs", {"pipeline": "inspect_bevel", "inputs": {"recording": "/etc/passwd"}}, "expected a file"),
        ("POST", "/api/runs", b"{", "not understood"),
        ("POST", "/api/runs", [], "not understood"),
        ("POST", "/api/presets", {"name": "../x", "pipeline": "inspect_bevel", "inputs": {}}, "expected a name"),
        ("PUT", "/api/files/..%2Fx.h5", b"x", ""),
        ("PUT", "/api/files/x.exe", b"x", "expected a recording"),
        ("PUT", "/api/files/x.h5", b"", "is empty"),
        ("GET", "/runs/99", None, "there is no run 99"),
        ("GET", "/operator?preset=none", None, "expected the name of a preset"),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(client, folder, method, path, body, words):
    before = sorted(folder.rglob("*"))
    status, text = client.ask(method, path, body)
    assert status in (400, 404)
    assert words in text
    assert "\n" not in text.strip()
    assert sorted(folder.rglob("*")) == before


def test_those_who_ask_at_once_get_one_answer_and_who_comes_later_a_new_one(client: Client) -> None:
    with ThreadPoolExecutor(20) as crowd:
        asked = [crowd.submit(client.ask, "GET", "/") for _ in range(60)]
        assert {one.result()[0] for one in asked} == {200}
    client.json("POST", "/api/presets", {"name": "later", "pipeline": "inspect_bevel", "inputs": {}})
    assert "later" in client.ask("GET", "/")[1]


def test_nobody_else_may_send(client: Client) -> None:
    body = {"look": "part-7.h5"}
    assert client.ask("POST", "/api/runs", body, Origin="http://example.com")[0] == 403
    assert client.ask("POST", "/api/runs", body, Host="example.com")[0] == 403
    assert client.ask("DELETE", "/api/runs/1")[0] == 405
    client.root = "/guess"
    assert client.ask("POST", "/api/runs", body)[0] == 403
    assert client.ask("PUT", "/api/files/a.h5", b"x")[0] == 403


def test_what_a_kill_left_at_work_is_done_again(tmp_path: Path) -> None:
    store = Store(tmp_path / "store.sqlite")
    number = store.add("look", {"file": "a.h5"})
    store.update(number, state="running", step="[1/2] scan.read")
    again = Store(tmp_path / "store.sqlite")
    assert again.next() is None  # the command line stores beside a server at work
    again.resume()
    found = again.next()
    assert (found.id, found.step) == (number, None)
    again.keep(Preset("P", "inspect_bevel", {"sections": 5}))
    again.keep(Preset("P", "inspect_bevel", {"sections": 7}))
    assert store.presets() == [Preset("P", "inspect_bevel", {"sections": 7})]


def test_what_is_no_store_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"no database" * 100)
    with pytest.raises(InputError, match="expected the store"):
        Store(tmp_path / "a")
    with pytest.raises(InputError, match="expected a folder"):
        Page(tmp_path / "none")


@pytest.mark.parametrize("name", pipelines())
def test_every_input_of_every_pipeline_is_a_field(name: str) -> None:
    path = Path(shipped_pipeline(name))
    _, fields = fields_of(path)
    tree = json.loads(path.read_text())
    assert [one.name for one in fields] == list(tree.get("inputs", {}))
    for one in fields:
        if isinstance(one.default, int | float) and not isinstance(one.default, bool):
            assert one.kind == "number"
        if one.kind == "choice":
            assert one.default in one.choices


def test_a_full_disk_is_told_and_leaves_nothing(client: Client, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    before = sorted(folder.rglob("*"))
    status, text = client.ask("PUT", "/api/files/big.h5", b"x" * 1000)
    assert (status, "No space left" in text) == (507, True)
    assert sorted(folder.rglob("*")) == before
