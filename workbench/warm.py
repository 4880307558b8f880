"""A child that has done the last run again, for nothing, and waits: the next run has all loaded from the start.

The first line on its standard input is what to do again, the second the arguments of the command to run. Between them
it says that it waits.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import redirect_stdout, suppress

from workbench.cli import main


def again(pipeline: str, inputs: dict[str, object], cache: str) -> None:
    """A run out of its cache, without results: what it loads and compiles stays."""
    from workbench import samples
    from workbench.pipeline.run import Pipeline

    path = pipeline if pipeline.endswith(".json") else samples.shipped_pipeline(pipeline)
    Pipeline.load(path).run(inputs=inputs, cache=cache)


def waiting() -> int:
    """Exit status of the command."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as main does, before numpy comes
    with suppress(Exception), redirect_stdout(sys.stderr):  # the run itself will tell
        again(*json.loads(sys.stdin.readline()))
    print(flush=True)
    arguments = sys.stdin.readline()
    return main(json.loads(arguments)) if arguments else 0


if __name__ == "__main__":
    sys.exit(waiting())
