"""Workers: processes of this machine, started once, kept warm, watched and replaced (POSIX); or dask's on others.

A worker of dask.distributed (the extra `[cluster]`) runs each part in a process of its own of the same kind,
so that a time limit ends it and a crash does not end the worker. Paths must mean the same on all machines (a shared
file system), or be URLs.
"""

from __future__ import annotations

import logging
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any

from workbench.batch.part import Job, Record, fail, run_part
from workbench.children import environment
from workbench.errors import InputError, OutputError, WorkbenchError
from workbench.extras import require
from workbench.geometry.blocks import cores

RUNS = 2  # of a part whose worker dies: the first death may come from outside, such as want of memory
PATIENCE_S = 2.0  # for a worker to tidy up before it is killed
THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
CONNECT_S = 10.0
_local = threading.local()  # on a worker of dask: each of its threads has a process


class Worker:
    """One process and the job that it has."""

    def __init__(self, working_dir: str, threads: int) -> None:
        self.connection, other = Pipe()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "workbench.batch.workers", str(other.fileno())],
            pass_fds=[other.fileno()],
            cwd=working_dir,
            env=environment(**dict.fromkeys(THREAD_VARIABLES, str(threads))),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is the parent's; and the whole group can be ended at once
        )
        other.close()
        self.ready = False
        self.job: Job | None = None
        self.started_s = 0.0

    def give(self, job: Job) -> None:
        """Send a job; a worker that has just died is noticed when its answer is awaited."""
        self.job, self.started_s = job, time.monotonic()
        with suppress(OSError):
            self.connection.send(job)

    def answer(self) -> Record | None:
        """What it has sent; None: that it is ready. EOFError: it is dead."""
        try:
            answer = self.connection.recv()
        except OSError:
            raise EOFError from None
        if answer == READY:
            self.ready = True
            return None
        self.job = None
        assert isinstance(answer, Record)
        return answer

    def signal(self, number: signal.Signals) -> None:
        """To the process and all that it has started."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, number)

    def end(self, patience_s: float = 0.0) -> str:
        """Stop it and all that it has started; how it ended, in words."""
        if patience_s:
            self.signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(patience_s)
        if self.process.returncode is None:  # not waited for: its number is still its own
            self.signal(signal.SIGKILL)
        self.process.wait()
        self.connection.close()
        return ended(self.process.returncode)


class Workers:
    """A few workers; `run` may be called again and again while they are warm."""

    def __init__(self, count: int, *, time_limit_s: float, working_dir: str = ".") -> None:
        self.count, self.time_limit_s, self.working_dir = count, time_limit_s, working_dir
        self.workers: list[Worker] = []

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End all of them; parts that are under way leave nothing."""
        for worker in self.workers:
            worker.signal(signal.SIGTERM)
        while self.workers:
            self.workers.pop().end(PATIENCE_S)

    def run(self, jobs: Iterable[Job]) -> Iterator[Record]:
        """The records of all jobs, each as it is done; no part stops another."""
        waiting, deaths = deque(jobs), dict[str, int]()
        left = len(waiting)
        while left:
            self._replenish(left)
            for worker in self.workers:
                if worker.ready and worker.job is None and waiting:
                    worker.give(waiting.popleft())
            for record in self._answers(waiting, deaths):
                left -= 1
                yield record

    def _replenish(self, left: int) -> None:
        while len(self.workers) < min(self.count, left):
            self.workers.append(Worker(self.working_dir, max(1, cores() // self.count)))

    def _answers(self, waiting: deque[Job], deaths: dict[str, int]) -> Iterator[Record]:
        """Wait for an answer, a death or the end of a time limit; what came of it."""
        spoken = wait([worker.connection for worker in self.workers], self._until_limit_s())
        for worker in [one for one in self.workers if one.connection in spoken]:
            try:
                answer = worker.answer()
            except EOFError:
                yield from self._buried(worker, waiting, deaths)
                continue
            if answer:
                yield answer
        for worker in [one for one in self.workers if one.job and self._overdue(one)]:
            job, _ = self._removed(worker, PATIENCE_S)
            assert job is not None
            yield fail(job, "hung", f"took longer than {self.time_limit_s:g} s and was stopped")

    def _buried(self, worker: Worker, waiting: deque[Job], deaths: dict[str, int]) -> Iterator[Record]:
        """A dead worker's part is run once more; that it died before it had one is nobody's part."""
        job, how = self._removed(worker)
        if job is None:
            if not worker.ready:
                raise OutputError("batch", f"no worker could be started: its process was {how}")
            return
        deaths[job.part] = deaths.get(job.part, 0) + 1
        if deaths[job.part] < RUNS:
            waiting.appendleft(job)
        else:
            yield fail(job, "crashed", f"its process was {how}, {RUNS} times")

    def _removed(self, worker: Worker, patience_s: float = 0.0) -> tuple[Job | None, str]:
        self.workers.remove(worker)
        return worker.job, worker.end(patience_s)

    def _overdue(self, worker: Worker) -> bool:
        return time.monotonic() - worker.started_s >= self.time_limit_s

    def _until_limit_s(self) -> float | None:
        """Time until the first part has had its time; None: none is at work."""
        busy = [worker.started_s for worker in self.workers if worker.job]
        return max(0.0, min(busy) + self.time_limit_s - time.monotonic()) if busy else None


def ended(status: int | None) -> str:
    """How a process ended, from its status."""
    if status is not None and status < 0:
        return f"killed by {signal.Signals(-status).name}"
    return f"ended with status {status}"


def here(jobs: Iterable[Job]) -> Iterator[Record]:
    """The records of all jobs, run in this process: no time limit, and nothing survives a crash."""
    return map(run_part, jobs)


class Cluster:
    """A scheduler that is there already."""

    def __init__(self, address: str, *, time_limit_s: float) -> None:
        require("distributed")
        from distributed import Client

        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # a lost scheduler is told in one line
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
