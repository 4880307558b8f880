"""Recordings and results behind URLs: fsspec's store in memory, and an object store's server on loopback."""

import hashlib
import json
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from workbench.batch import run_batch, store
from workbench.batch.store import refuse_credentials
from workbench.errors import InputError, OutputError

Write = Callable[..., str]
RESULTS = {"inspection.json", "part.json", "report.html", "run.json"}


pytestmark = pytest.mark.usefixtures("plain_page")


@pytest.fixture
def memory() -> Iterator[Any]:
    """fsspec's store in this process."""
    import fsspec

    files = fsspec.filesystem("memory")
    yield files
    files.store.clear()
    files.pseudo_dirs[:] = [""]


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    """The address of an object store that speaks S3."""
    server_of = pytest.importorskip("moto.server", reason="needs moto[s3]")
    pytest.importorskip("s3fs", reason="needs the extra [s3]")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    running = server_of.ThreadedMotoServer(ip_address="127.0.0.1", port=port, verbose=False)
    running.start()
    yield f"http://127.0.0.1:{port}"
    running.stop()


@pytest.fixture
def bucket(server: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """An empty bucket, and the environment in which it is reached."""
    import s3fs

    for name, value in {
        "AWS_ENDPOINT_URL": server,
        "AWS_ACCESS_KEY_ID": "somebody",
        "AWS_SECRET_ACCESS_KEY": "very secret",
        "AWS_DEFAULT_REGION": "us-east-1",
        "NO_PROXY": "127.0.0.1",
    }.items():
        monkeypatch.setenv(name, value)
    s3fs.S3FileSystem.clear_instance_cache()
    files = s3fs.S3FileSystem()
    files.mkdir("plant")
    yield files
    files.rm("plant", recursive=True)
    s3fs.S3FileSystem.clear_instance_cache()


def local_and_remote(files: Any, base: str, record: Write, pipeline: Path, tmp_path: Path, workers: int) -> None:
    """The same batch from files and from URLs: the same results, the recordings' addresses apart."""
    paths = [record("part-1"), record("part-10", "reject"), record("part-2", "unusable")]
    for path in paths:
        files.pipe_file(f"{base}/in/{Path(path).name}", Path(path).read_bytes())
    out, url = tmp_path / "out", files.unstrip_protocol(f"{base}/out")
    pattern = files.unstrip_protocol(f"{base}/in/*.h5")
    run_batch(pipeline, paths, str(out), workers=0)
    made = run_batch(pipeline, [pattern], url, workers=workers, cache=str(tmp_path / "cache"))
    assert [one.part for one in made.records] == ["part-1", "part-2", "part-10"]
    assert [one.outcome for one in made.records] == ["passed", "failed", "rejected"]
    assert made.records[1].cause == f"{files.unstrip_protocol(f'{base}/in/part-2.h5')}: expected something else"
    for name in ("part-1", "part-10"):
        assert {path.rpartition("/")[2] for path in files.ls(f"{base}/out/{name}", detail=False)} == RESULTS
        for file in ("inspection.json", "report.html"):
            assert files.cat_file(f"{base}/out/{name}/{file}") == (out / name / file).read_bytes()
        run = json.loads(files.cat_file(f"{base}/out/{name}/run.json"))
        assert run["inputs"][0]["path"] == files.unstrip_protocol(f"{base}/in/{name}.h5")
        digest = hashlib.sha256((tmp_path / "recordings" / f"{name}.h5").read_bytes()).hexdigest()
        assert run["inputs"][0]["sha256"] == digest
    assert files.cat_file(f"{base}/out/fleet.parquet")[:4] == b"PAR1"
    assert len([*(tmp_path / "cache").glob("*/*.h5")]) == 3
    again(files, base, pipeline, pattern, url)


def again(files: Any, base: str, pipeline: Path, pattern: str, url: str) -> None:
    """What is whole is not made again; what is cut off, or rests on another recording, is."""

    def ran() -> list[str]:
        return [one.part for one in run_batch(pipeline, [pattern], url, workers=0).records if not one.skipped]

    assert ran() == ["part-2"]
    files.pipe_file(f"{base}/out/part-1/report.html", b"<p>")
    assert ran() == ["part-1", "part-2"]
    files.pipe_file(f"{base}/in/part-10.h5", b"unusable\n1.5 1.6\n")
    assert ran() == ["part-2", "part-10"]
    assert {path.rpartition("/")[2] for path in files.ls(f"{base}/out/part-10", detail=False)} == {"part.json"}


def test_a_store_in_memory(memory: Any, record: Write, pipeline: Path, tmp_path: Path) -> None:
    local_and_remote(memory, "/plant", record, pipeline, tmp_path, workers=0)


def test_an_object_store_on_loopback(bucket: Any, record: Write, pipeline: Path, tmp_path: Path) -> None:
    local_and_remote(bucket, "plant", record, pipeline, tmp_path, workers=1)


def test_without_a_cache_copies_go(memory, record, pipeline, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    memory.pipe_file("/in/a.h5", Path(record("a")).read_bytes())
    assert run_batch(pipeline, ["memory://in/a.h5"], str(tmp_path / "out"), workers=0).exit_status == 0
    assert not [*(tmp_path / "temporary").iterdir()]


def test_files_of_this_machine_as_urls(record: Write, pipeline: Path, tmp_path: Path) -> None:
    made = run_batch(pipeline, [f"file://{record('a')}"], f"file://{tmp_path}/out", workers=0)
    assert made.exit_status == 0
    assert (tmp_path / "out" / "a" / "run.json").exists()


def test_a_store_that_does_not_answer_is_one_line(bucket: Any, pipeline: Path, monkeypatch: Any) -> None:
    for url, why in (("s3://nowhere/*.h5", "found none|no such|NoSuchBucket"), ("s3://plant/in/", "found none")):
        with pytest.raises(InputError, match=why):
            run_batch(pipeline, [url], "s3://plant/out", workers=0)
    made = run_batch(pipeline, ["s3://plant/in/absent.h5"], "s3://plant/out", workers=0)
    assert made.records[0].cause == "s3://plant/in/absent.h5: no such file"


def test_credentials_in_a_url_are_refused_and_not_shown(pipeline: Path, record: Write, tmp_path: Path) -> None:
    out, url = tmp_path / "out", "s3://key:hushhush@bucket/a.h5"
    for recordings, place in (([url], str(out)), ([record("a")], url)):
        with pytest.raises(InputError, match="come from the environment") as refused:
            run_batch(pipeline, recordings, place, workers=0)
        assert "hushhush" not in str(refused.value)
    assert not out.exists()


def test_credentials_in_a_message_are_struck_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "abc/def+ghi")
    assert store.without_secrets("signed with abc/def+ghi here") == "signed with *** here"


def test_a_missing_extra_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    import fsspec

    assert fsspec.__version__
    monkeypatch.setitem(sys.modules, "s3fs", None)
    monkeypatch.delitem(sys.modules["fsspec.registry"]._registry, "s3", raising=False)
    with pytest.raises(OutputError, match=r"is not installed: pip install .bevel-workbench\[s3\]."):
        store.write_file("s3://bucket/out", "a", b"")


def test_a_file_is_never_seen_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(b"old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OutputError, match="No space left on device"):
        store.write_whole(path, b"new")
    assert [*tmp_path.iterdir()] == [path]
    assert path.read_bytes() == b"old"


@pytest.mark.parametrize(
    "url", ["zip://x::file:///etc", "simplecache::s3://a", "ssh://host/x", "github://a:b@/x", "local:///etc"]
)
def test_other_schemes_than_the_named_ones_are_refused(url: str) -> None:
    with pytest.raises(InputError, match="expected a path or a URL of"):
        refuse_credentials(url)
