"""Rows of the table about batches of small parts: inspected to `inspection.json`, without a report."""

from __future__ import annotations

import json
import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench.speed.timing import Row, seconds
from workbench.batch.part import Job, Record
from workbench.batch.workers import Workers
from workbench.pipeline.document import read_document
from workbench.synthetic.recipe_file import parse_recipe
from workbench.synthetic.simulate import write_simulation

COLUMNS, FRAME_PITCH_MM, SCANNED_MM, MARGIN_MM = 300, 0.5, 60.0, 5.0
ROOT_SPREAD_MM, BEVEL_SPREAD_DEG, DRIFT_MM = 0.05, 0.15, 0.1  # part to part; of the root over all parts


def recipe(number: int, share: float) -> dict[str, Any]:
    """Part `number`, made after a share of all."""
    rng = np.random.default_rng([7, number])
    root_mm = 1.45 + DRIFT_MM * share + ROOT_SPREAD_MM * rng.normal()
    bevel_deg = 40.0 + BEVEL_SPREAD_DEG * rng.normal()
    return {
        "format": "bevel-recipe",
        "version": 1,
        "part_id": f"part {number}",
        "seed": number,
        "part": {
            "length_mm": SCANNED_MM + 2 * MARGIN_MM,
            "root_mm": {"start": root_mm, "end": root_mm - 0.08, "amplitude": 0.06, "wavelength_mm": 50},
            "bevel_deg": {"start": bevel_deg, "end": bevel_deg + 0.1},
            "table_gap_mm": 25,
            "base_from_part": {"position_mm": [1450, -320, 760], "rpy_deg": [35, 2.5, -1.5]},
        },
        "scanner": {"columns": COLUMNS, "pitch_mm": 0.1, "near_mm": 120, "far_mm": 190},
        "robot": {"frame_pitch_mm": FRAME_PITCH_MM, "pose_noise_mm": 0.02, "pose_noise_deg": 0.002},
        "disturbances": {"dropout_share": 0.005, "outlier_share": 0.004},
        "passes": [
            {
                "from_mm": MARGIN_MM,
                "to_mm": MARGIN_MM + SCANNED_MM,
                "elevation_deg": 42,
                "oblique_deg": 2.5,
                "lead_deg": -3,
                "aim_mm": [-4, 4],
            }
        ],
    }


def simulated_parts(count: int, folder: Path) -> Iterator[Path]:
    """The recordings, one after the other."""
    for number in range(1, count + 1):
        path = folder / f"part-{number:04d}.h5"
        write_simulation(parse_recipe(recipe(number, number / count)), path)
        yield path


PIPELINE = Path("pipelines/inspect_bevel.json")
TIME_LIMIT_S = 600.0
WARM_UP = 4  # parts a worker that are not counted
CLUSTER_PARTS = 60
MEASURED = ("passed", "rejected")  # undecided: U holds a rounding of the lower edge


def batches(count: int) -> Iterator[Row]:
    """One worker and two in turn; what a part costs beside its pipeline; memory; a dask worker that is killed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings = [*simulated_parts(count, folder)]
        pipeline = short_pipeline(folder)
        one_s, records, memory_mb = timed(1, pipeline, recordings, folder / "one")
        two_s, _, _ = timed(2, pipeline, recordings, folder / "two")
        yield Row(
            f"{count:,} small parts, two workers; one worker",
            seconds(two_s),
            seconds(one_s),
            one_s / two_s,
            "{:.2f} x faster",
            goal=1.8,
        )
        own_s = sum(record.seconds for record in records) / count
        overhead_s = one_s / count - own_s
        yield Row(
            "a small part in a warm worker; its pipeline's stages alone",
            seconds(one_s / count),
            seconds(own_s),
            1e3 * overhead_s,
            "{:.1f} ms of overhead",
            goal=50,
            at_most=True,
        )
        early_mb, late_mb = memory_mb[len(memory_mb) // 10], memory_mb[-1]
        yield Row(
            f"memory of a worker after {count:,} parts; after a tenth of them",
            f"{late_mb:.0f} MB",
            f"{early_mb:.0f} MB",
            late_mb / early_mb,
            "{:.3f} x as much",
            goal=1.05,
            at_most=True,
        )
        yield from on_a_cluster(pipeline, recordings[:CLUSTER_PARTS], folder)


def short_pipeline(folder: Path) -> Path:
    """The shipped inspection without its report."""
    document = json.loads(PIPELINE.read_text())
    document["stages"] = [one for one in document["stages"] if not one["stage"].startswith("report.")]
    path = folder / "inspect.json"
    path.write_text(json.dumps(document))
    return path


def timed(workers: int, pipeline: Path, recordings: list[Path], out: Path) -> tuple[float, list[Record], list[float]]:
    """Seconds for all parts once the workers are warm, the records, and a worker's resident memory after each part."""
    jobs = [job(pipeline, path, out) for path in recordings]
    warm_up = [job(pipeline, path, out / "warm-up") for path in recordings[: WARM_UP * workers]]
    records, memory_mb = [], []
    with Workers(workers, time_limit_s=TIME_LIMIT_S) as team:
        list(team.run(warm_up))
        start_s = time.perf_counter()
        for record in team.run(jobs):
            records.append(record)
            memory_mb.append(resident_mb(team.workers[0].process.pid))
        spent_s = time.perf_counter() - start_s
    unmeasured = [record.cause for record in records if record.outcome not in MEASURED]
    if unmeasured:
        raise AssertionError(f"expected every part to be measured: {unmeasured[:3]}")
    return spent_s, records, memory_mb


def on_a_cluster(pipeline: Path, recordings: list[Path], folder: Path) -> Iterator[Row]:
    """Two dask workers on loopback, one killed after a quarter: how many parts are not as they should be."""
    from distributed import LocalCluster

    from workbench.batch import run_batch

    out, paths = folder / "cluster", [str(path) for path in recordings]
    with LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1", silence_logs=50
    ) as cluster:

        def kill_one() -> None:
            while len([*out.glob("*/run.json")]) < len(recordings) // 4:
                time.sleep(0.05)
            os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)

        threading.Thread(target=kill_one, daemon=True).start()
        start_s = time.perf_counter()
        made = run_batch(pipeline, paths, str(out), scheduler=cluster.scheduler_address)
        spent_s = time.perf_counter() - start_s
    wrong = sum(record.outcome not in MEASURED for record in made.records) + abs(len(made.records) - len(recordings))
    for path in recordings:
        wrong += not same_results(out / path.stem, folder / "one" / path.stem)
    yield Row(
        f"{len(recordings)} small parts, two dask workers, one killed in the middle",
        seconds(spent_s),
        "",
        wrong,
        "{:.0f} parts lost, doubled or other than on one machine",
        goal=0,
        at_most=True,
    )


def same_results(folder: Path, other: Path) -> bool:
    """The same files with the same content; times, and what lists them, apart."""
    names, others = ({path.name for path in each.iterdir()} for each in (folder, other))
    timed = {"run.json", "part.json"}
    return names == others and all((folder / n).read_bytes() == (other / n).read_bytes() for n in names - timed)


def job(pipeline: Path, recording: Path, out: Path) -> Job:
    return Job(recording.stem, str(recording), read_document(pipeline), {}, {}, str(out / recording.stem), os.getcwd())


def resident_mb(pid: int) -> float:
    """Of a process, from the kernel."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) * 1024 / 1e6
