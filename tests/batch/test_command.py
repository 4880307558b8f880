"""`workbench batch`: exit status, table on stdout, progress on stderr, arguments refused in one line."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from workbench.cli import main

Write = Callable[..., str]
pytestmark = pytest.mark.usefixtures("plain_page")


@pytest.fixture
def batch(pipeline: Path, tmp_path: Path, capsys: Any) -> Callable[..., tuple[int, str, str]]:
    def run(*arguments: str) -> tuple[int, str, str]:
        status = main(["batch", str(pipeline), *arguments, "--out", str(tmp_path / "out"), "--workers", "0"])
        return status, *capsys.readouterr()

    return run


def test_status_and_table(batch: Any, record: Write) -> None:
    good, bad, torn = record("good"), record("bad", "reject"), record("torn", "unusable")
    status, out, err = batch(good)
    assert (status, err.splitlines()) == (0, [err.splitlines()[0]])
    assert err.startswith("[1/1] 1 passed, took")
    assert "1 parts, 1 passed (verdicts: 1 pass)" in out
    status, out, err = batch(good, bad)
    assert status == 1
    assert "error" not in err
    assert "2 parts, 1 rejected, 1 passed (verdicts: 1 fail, 1 pass); 1 from an earlier run" in out
    status, out, err = batch(good, bad, torn)
    assert status == 2
    assert err.splitlines()[-1].startswith(f"error: {torn}: ")
    assert err.splitlines()[-1].endswith("(1 of 3 parts have no results)")
    rows = [line.split()[1] for line in out.splitlines() if line.startswith("│") and line.split()[1] != "│"]
    assert rows == ["torn", "bad"]  # worst first; what passed is not listed
    assert out.rstrip().endswith("fleet.parquet")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "the following arguments are required: RECORDING"),
        (["a.h5", "--workers", "-1"], "expected a whole number, 0 or more, got '-1'"),
        (["a.h5", "--time-limit-s", "0"], "expected a time in s above 0, got '0'"),
        (["a.h5", "--time-limit-s", "nan"], "expected a time in s above 0"),
        (["a.h5", "--scheduler", "tcp://x:1"], "not allowed with argument"),
        (["a.h5", "--time-limit", "3"], "unknown option '--time-limit'; did you mean '--time-limit-s'?"),
        (["a.h5", "--input", "shift=1"], "the pipeline has no input 'shift'; did you mean 'shift_mm'?"),
        (["none.h5"], "none.h5: no such file"),
        (["none-*.h5"], "none-*.h5: expected recordings (*.h5) by this name, found none"),
        (["a.h5", "x/a.h5"], "as those of a.h5: expected file names that differ"),
    ],
)
def test_arguments_are_refused_in_one_line(batch: Any, tmp_path: Path, arguments: list[str], message: str) -> None:
    status, out, err = batch(*arguments)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert message in err
    assert not (tmp_path / "out").exists()
