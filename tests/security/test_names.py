"""Texts that a file carries stay texts, wherever they come out: page, program, table, terminal, file name."""

import csv
import io
import json

import pytest

from tests.conftest import forget_strangers
from tests.report.conftest import Elements
from tests.security.hostile import MARKUP, NAMES, PROGRAM, assert_plain_lines, assert_refused, files_below
from workbench.api import Chapter, Document, stage
from workbench.errors import one_line

INSPECT = (
    {"stage": "scan.read", "recording": "${recording}"},
    {"stage": "scan.fuse"},
    {"stage": "cloud.denoise"},
    {"stage": "edge.segment"},
    {"stage": "inspect.sections", "sections": 2},
    {"stage": "inspect.gate", "reject": ["fail"]},
)
TABLE = {"stage": "export.inspection", "format": "csv"}


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_a_part_that_is_inspected(name, hostile_part, pipeline_file, command, tmp_path):
    """Tables hold the name as a text; nothing is written but the results; the terminal sees plain lines."""
    path = hostile_part(name)
    before = files_below(tmp_path)
    pipeline = pipeline_file(*INSPECT, TABLE, recording=str(path), title=name[:500])
    outcome = command("run", pipeline, "--out", tmp_path / "out")
    assert outcome.status in (0, 1), outcome.err
    assert_plain_lines(outcome.out + outcome.err)
    assert files_below(tmp_path) - before - {"pipeline.json", "out"} == {
        f"out/{file}" for file in ("inspection.json", "inspection.csv", "run.json")
    }
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out/inspection.csv").read_bytes().decode(), newline="")))
    assert len(rows) == 2
    for row in rows:
        assert not any(text.startswith(("=", "+", "@", "\t", "\r", "\n")) for text in row.values())
        assert row["part_id"].lstrip("'")[:40] == one_line(name.replace("\x00", " ")).lstrip("'")[:40]
    json.loads((tmp_path / "out/run.json").read_text())


@pytest.mark.parametrize(
    "file_name",
    ["=1+2.h5", "a\nerror: forged\n.h5", "<img src=x onerror=alert(1)>.h5", "%%%!.h5", "-out.h5", "${x}.h5"],
)
def test_a_recording_with_a_hostile_file_name(file_name, hostile_part, pipeline_file, command, tmp_path):
    path = hostile_part("plate", file_name)
    outcome = command(
        "run",
        pipeline_file(*INSPECT, TABLE, recording="x"),
        "--out",
        tmp_path / "out",
        "--input",
        f"recording={path}",
    )
    assert outcome.status in (0, 1), outcome.err
    assert_plain_lines(outcome.out + outcome.err)
    path.write_bytes(b"not HDF5")
    outcome = command(
        "run", pipeline_file(*INSPECT, recording="x"), "--out", tmp_path / "out2", "--input", f"recording={path}"
    )
    assert_refused(outcome, "part" if "part" in file_name else file_name.partition("\n")[0])
    assert not (tmp_path / "out2").exists()


@pytest.fixture
def stranger():
    """A plug-in that hands on what a file says."""

    @stage("hostile.page")
    def page(*, title: str, html: str = "<p>x</p>", warning: str = "w", summary: str = "", part: str = "") -> Chapter:
        """Make a chapter."""
        return Chapter(title, html, "", summary, part, (warning,))

    @stage("hostile.file")
    def file(*, name: str) -> Document:
        """Make a file."""
        return Document(name, b"x")

    yield
    forget_strangers()


@pytest.mark.parametrize("text", NAMES.values(), ids=NAMES)
def test_every_text_of_a_chapter_is_escaped(stranger, text, pipeline_file, command, tmp_path):
    text = text.replace("${", "$ {")  # in a pipeline that is a reference to an input
    pipeline = pipeline_file(
        {"stage": "hostile.page", "title": text, "warning": text, "summary": text, "part": text},
        {"stage": "hostile.page", "id": "other", "title": "b"},
        {"stage": "report.html"},
        title=text,
    )
    outcome = command("run", pipeline, "--out", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    assert_plain_lines(outcome.out + outcome.err)
    page = Elements((tmp_path / "out/report.html").read_text(encoding="utf-8"))
    for tag, attributes in page.tags:
        assert tag != "script" or attributes.get("type") == "application/json"
        assert not any(name.startswith("on") or "javascript:" in (value or "") for name, value in attributes.items())
        assert (attributes.get("src") or "data:").startswith("data:")
    if "<script>" in text:
        assert page.text.count("<script>alert(1)</script>") >= 4
        assert str(7 * 191 * 1000003) not in page.text  # no template ran it


@pytest.mark.parametrize(
    "html",
    [
        "<script>alert(1)</script>",
        "<img src='http://a/b.png'>",
        "<p onclick='x()'>y</p>",
        "<a href='javascript:x()'>y</a>",
        "<iframe srcdoc='x'></iframe>",
        "<meta http-equiv=refresh content='0;url=http://a'>",
        "<base href='http://a'>",
        "<svg><image xlink:href='http://a/b'/></svg>",
        "<form action='http://a'></form>",
        "<SCRIPT>x</SCRIPT>",
        "<p style='background:url(http://a)'>x</p>",
        "<p style='background:URL(http://a)'>x</p>",
        "<style>@import 'http://a'</style>",
        "<style>p{background:u\\72l(http://a)}</style>",
        "<a href='data:text/html,<script>alert(1)</script>'>x</a>",
        "<button formaction='javascript:x()'>x</button>",
        "<a ping='http://a' href='#b'>x</a>",
    ],
)
def test_html_that_reaches_outside_is_refused(stranger, html, pipeline_file, command, tmp_path):
    pipeline = pipeline_file({"stage": "hostile.page", "title": "a", "html": html}, {"stage": "report.html"})
    assert_refused(command("run", pipeline, "--out", tmp_path / "out"), "complete in itself")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "name",
    [
        *("../x", "a/b", "/tmp/x", "..", ".", "", ".hidden", "a\\b", "run.json"),
        *("a\nb", "a\x00b", "\x1b[31m", "C:\\x", "a\u202eb"),
    ],
)
def test_a_result_can_only_be_a_visible_file_in_the_folder(stranger, name, pipeline_file, command, tmp_path):
    before = files_below(tmp_path)
    outcome = command("run", pipeline_file({"stage": "hostile.file", "name": name}), "--out", tmp_path / "out")
    assert_refused(outcome, "file name")
    assert files_below(tmp_path) - before == {"pipeline.json"}


@pytest.mark.parametrize(
    "change",
    [
        {"id": "../x"},
        {"id": "a b"},
        {"id": PROGRAM},
        {"id": MARKUP},
        {"stage": "../../os.system"},
        {"stage": "os.system"},
        {"stage": "subprocess.run"},
        {"stage": "workbench.cli.main"},
        {"stage": MARKUP},
        {"from": {PROGRAM: "x"}},
        {PROGRAM: 1},
        {"__class__": 1},
    ],
)
def test_names_in_a_pipeline_that_are_none(stranger, change, pipeline_file, command, tmp_path):
    """Only registered stages run: no name is looked up as a module of anybody's choice."""
    pipeline = pipeline_file({"stage": "hostile.file", "name": "x.txt", **change})
    assert_refused(command("run", pipeline, "--out", tmp_path / "out"), "stages[0]")
    assert not (tmp_path / "out").exists()
