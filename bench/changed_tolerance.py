"""`python -m bench.changed_tolerance`: how long `workbench open` takes to judge a part again by another tolerance.

The wall time from the request to the verdict as a page that asks sees it, so the machine should be idle.
"""

from __future__ import annotations

import http.client
import json
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from bench.neighbours import served, tell

SAMPLE = Path(__file__).parents[1] / "data" / "synthetic" / "milled_edge.h5"
CHANGES, REST_S = 8, 8.0  # how often, and how long somebody looks at the answer


def main() -> None:
    """Print the first answer, and those to changed tolerances."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(SAMPLE, Path(folder) / "part.h5")
        with served("open", folder) as (port, path):
            tell("first", [answer_s(port, path, 1.0)])
            waits = []
            for k in range(CHANGES):
                time.sleep(REST_S)
                waits.append(answer_s(port, path, 0.9 - 0.05 * k))
            tell("tolerance changed", waits)


def answer_s(port: int, path: str, tolerance_deg: float) -> float:
    """From the request to the verdict; the run is then let come to its end."""
    inputs = {"recording": "part.h5", "bevel_tolerance_deg": [-tolerance_deg, tolerance_deg]}
    begin, waited = time.monotonic(), float("inf")
    number = asked(port, "POST", f"{path}api/runs", {"pipeline": "inspect_bevel", "inputs": inputs})["id"]
    while (run := asked(port, "GET", f"{path}api/runs/{number}"))["state"] in ("queued", "running"):
        if run["verdict"]:
            waited = min(waited, time.monotonic() - begin)
        time.sleep(0.02)
    return waited


def asked(port: int, method: str, path: str, body: Any = None) -> Any:
    """The answer to one request, out of JSON."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request(method, path, json.dumps(body))
    return json.loads(connection.getresponse().read())


if __name__ == "__main__":
    main()
