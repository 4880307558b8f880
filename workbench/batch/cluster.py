"""Workers on other machines: dask.distributed, the extra `workbench[cluster]`.

A worker of dask runs each part in a process of its own (`workbench.batch.processes`), so that a time limit ends it and
a crash does not end the worker. Paths must mean the same on all machines (a shared file system), or be URLs.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Any

from workbench.batch.part import Job, fail
from workbench.batch.processes import RUNS, Workers
from workbench.batch.record import Record
from workbench.errors import InputError, WorkbenchError

CONNECT_S = 10.0
_local = threading.local()  # on a worker of dask: each of its threads has a process


class Cluster:
    """A scheduler that is there already."""

    def __init__(self, address: str, *, time_limit_s: float) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError("--scheduler", "needs dask.distributed: install workbench[cluster]") from None
        self.address, self.time_limit_s = address, time_limit_s
        try:
            connect: Any = Client
            self.client = connect(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(address, f"no scheduler answers there ({type(error).__name__})") from None

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.client.close()

    def run(self, jobs: Sequence[Job]) -> Iterator[Record]:
        """The records of all jobs, each as it is done; a part whose worker is lost is run on another."""
        import distributed
        from distributed import CancelledError, KilledWorker

        as_completed: Any = distributed.as_completed
        futures = {self.client.submit(run_supervised, job, self.time_limit_s, pure=False): job for job in jobs}
        try:
            for future in as_completed(futures, loop=self.client.loop):
                try:
                    yield future.result()
                except KilledWorker:
                    yield fail(
                        futures[future], "crashed", f"the workers that it ran on were lost, {RUNS} times or more"
                    )
                except CancelledError:
                    raise InputError(self.address, "the scheduler is gone; the same command carries on") from None
                except WorkbenchError:
                    raise
                except Exception as error:  # workbench is not there, or another version
                    why = f"its workers cannot run a part: {type(error).__name__}: {error}"
                    raise InputError(self.address, why) from error
                future.release()
        finally:
            self.client.cancel(list(futures), force=True)


def run_supervised(job: Job, time_limit_s: float) -> Record:
    """On a worker of dask: the job in this thread's own process, which stays warm for the next one."""
    workers: Workers | None = getattr(_local, "workers", None)
    if workers is None or (workers.time_limit_s, workers.working_dir) != (time_limit_s, job.working_dir):
        if workers:
            workers.close()
        workers = _local.workers = Workers(1, time_limit_s=time_limit_s, working_dir=job.working_dir)
    (record,) = workers.run([job])
    return record
