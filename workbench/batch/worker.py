"""A worker process, `python -m workbench.batch.worker DESCRIPTOR`: takes jobs from a connection, answers with records.

It leads a process group of its own, and takes it along when whoever started it is gone.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
from multiprocessing.connection import Connection

from workbench.batch.part import Job, run_part

READY = "ready"  # sent once, after the imports


def main(descriptor: int) -> None:
    """Work until the connection ends."""
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))  # temporary folders go
    connection = Connection(descriptor)
    jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(connection, jobs), daemon=True).start()
    connection.send(READY)
    while True:
        connection.send(run_part(jobs.get()))


def _listen(connection: Connection, jobs: queue.SimpleQueue[Job]) -> None:
    """Jobs as they come; the end of the connection is the end of this process and of what it has started."""
    try:
        while True:
            jobs.put(connection.recv())
    except (EOFError, OSError):
        os.killpg(os.getpgid(0), signal.SIGKILL)


if __name__ == "__main__":
    main(int(sys.argv[1]))
