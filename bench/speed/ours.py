"""This project's way from a recording to its inspection. `python -m bench.speed.ours FILE` prints its peak memory."""

from __future__ import annotations

import sys
from pathlib import Path

from workbench.artefacts import Inspection, Recording


def inspect(recording: Recording) -> Inspection:
    """The stages of pipelines/inspect_bevel.json, less reading and report."""
    from workbench.cloud import denoise
    from workbench.edge import segment
    from workbench.inspect import sections
    from workbench.scan import fuse

    return sections(segment(denoise(fuse(recording))))  # type: ignore[no-any-return]


def read_and_inspect(path: Path) -> Inspection:
    """From the file."""
    from workbench.scan import read

    return inspect(read(recording=path))


def peak_bytes() -> int:
    """Largest resident memory of this process so far.

    From the kernel's own count where there is one: `resource.getrusage` also counts the process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    read_and_inspect(Path(sys.argv[1]))
    print(peak_bytes())
