"""A share of `bench.kills`: the seeds under which a lost device or a full disk once ended in a traceback."""

import shutil
import subprocess
import sys

import pytest

from bench.harness import ROOT


@pytest.mark.skipif(shutil.which("cc") is None or sys.platform != "linux", reason="the injector is C for glibc")
@pytest.mark.parametrize("command", ["run", "store"])
def test_a_fault_under_any_operation_leaves_a_whole_set_and_one_line(command):
    cases = ["--only", command, "--seed", "100000", "--cases", "24"]
    done = subprocess.run(
        [sys.executable, "-m", "bench.kills", *cases], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
