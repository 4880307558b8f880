"""`workbench run --follow FILE.h5`: measure a recording while it is written, and run the pipeline when it is complete.

A recording that grows is an HDF5 file in SWMR mode (single writer, multiple readers: `libver="latest"`,
`swmr_mode = True`). It is complete when its writer has closed it: HDF5 then clears a mark in the file's first bytes. A
writer without SWMR mode holds a lock instead, and nothing of its file can be read before it is closed.

What is told on the way is measured on copies of the frames so far. The results are those of the complete file, read as
always: so they are the same bytes as without `--follow`, and all that has to be loaded is loaded by then.
"""

from __future__ import annotations

import os
import signal
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from workbench.artefacts import Cloud, Gate, Inspection, Joint, JointInspection, MilledEdge
from workbench.artefacts.edges import RecognisedInspection
from workbench.errors import ArgumentError, InputError, WorkbenchError, one_line
from workbench.pipeline.run import Pipeline, Results
from workbench.storage import new_hdf5, write_whole

State = Literal["absent", "growing", "locked", "killed", "closed"]
RECORDING = "recording"  # the pipeline's input
SIGNATURE = b"\x89HDF\r\n\x1a\n"
MARKED_FROM = 3  # version of the superblock that holds the mark
POLL_S = 0.01
GROWTH = 1.3  # frames are measured again when there are so many times as many: all measuring costs a few runs
LEAST_FRAMES = 40


def follow(
    pipeline: Pipeline,
    path: Path,
    stall_s: float,
    tell: Callable[[str], None],
    inputs: Mapping[str, Any],
    settings: Mapping[str, Any],
    drawing: Path | None = None,
) -> None:
    """Wait until the recording at `path` is complete, and tell what its frames so far show.

    Args:
        pipeline: with an input `recording`.
        path: the recording; it need not be there yet.
        stall_s: so long may the file stay as it is.
        tell: takes a line at a time.
        inputs, settings: as of the run.
        drawing: where the sections of the frames so far are drawn, as SVG.

    Raises:
        ArgumentError: the pipeline has no input `recording`.
        InputError: the writer stalls, or was killed.
    """
    if RECORDING not in pipeline.document.inputs:
        raise ArgumentError("--follow", f"expected a pipeline with the input '{RECORDING}'")
    seen: tuple[int, int] | None = None
    since = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="workbench-follow-") as folder:
        sight = _Sight(pipeline, path, Path(folder) / path.name, tell, inputs, settings, drawing)
        try:
            while (state := state_of(path)) != "closed":
                if state == "killed":
                    raise InputError(str(path), "was not closed, and nobody writes it: its writer was killed")
                now = _size(path)
                if now != seen:
                    seen, since = now, time.monotonic()
                elif time.monotonic() - since > stall_s:
                    raise InputError(str(path), _stalled(state, stall_s))
                if state == "growing":
                    sight.look()
                time.sleep(POLL_S)
        finally:
            sight.end()


def state_of(path: Path) -> State:
    """How far a recording's file has come: by the mark in its first bytes, and by who locks it."""
    try:
        with path.open("rb") as file:
            head, free = file.read(12), _free(file.fileno())
    except OSError:
        return "absent"
    if not free:
        return "locked"
    if len(head) < 12 or not head.startswith(SIGNATURE) or head[8] < MARKED_FROM:
        return "closed"  # or no HDF5 file at all, which its reader will tell
    marks = head[11]
    return "growing" if marks & 4 else "killed" if marks & 1 else "closed"


def _free(descriptor: int) -> bool:
    """Whether no writer holds the file's lock."""
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except ImportError:
        return True
    except OSError:
        return False
    return True


def _size(path: Path) -> tuple[int, int] | None:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


def _stalled(state: State, stall_s: float) -> str:
    waited = f"for {stall_s:g} s (--stall-s)"
    if state == "absent":
        return f"no such file {waited}"
    if state == "locked":
        return f"has not grown {waited}, and its writer, which is not in SWMR mode, has not closed it"
    return (
        f"has not grown {waited} and was not closed: its writer stalls or was killed; "
        "after `h5clear -s` it can be run as it is, without --follow"
    )


class _Sight:
    """Measures the frames so far: the first time here, which loads and compiles all that is needed, then in children.

    So nothing keeps the last run waiting.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        path: Path,
        copy: Path,
        tell: Callable[[str], None],
        inputs: Mapping[str, Any],
        settings: Mapping[str, Any],
        drawing: Path | None,
    ) -> None:
        self.pipeline, self.path, self.copy, self.tell, self.drawing = pipeline, path, copy, tell, drawing
        self.inputs, self.settings = {**inputs, RECORDING: str(copy)}, settings
        self.frames, self.child = 0, 0

    def look(self) -> None:
        """Measure again, if there are enough new frames, and the last measurement is done."""
        if self.child and os.waitpid(self.child, os.WNOHANG)[0]:
            self.child = 0
        if self.child or (self.frames and not hasattr(os, "fork")):
            return
        try:
            frames = copy_complete_frames(self.path, self.copy, max(LEAST_FRAMES, round(GROWTH * self.frames)))
        except (OSError, RuntimeError, KeyError, ValueError):  # in the midst of a change: the next time, then
            return
        if not frames:
            return
        first, self.frames = not self.frames, frames
        if first:
            self._measure()
            return
        self.child = os.fork()
        if not self.child:
            try:
                self._measure()
            finally:
                os._exit(0)

    def end(self) -> None:
        """Nobody waits for what is being measured."""
        if self.child:
            os.kill(self.child, signal.SIGKILL)
            os.waitpid(self.child, 0)

    def _measure(self) -> None:
        try:
            results = self.pipeline.run(inputs=self.inputs, settings=self.settings, report=False)
            reasons = [one.reason for one in results if isinstance(one, Gate)]
            reasons += [sizes for one in results if isinstance(one, JointInspection) and (sizes := _sizes(one))]
            shown = "; ".join(reasons) or "measured"
            if self.drawing and (drawn := _drawn(results)):
                write_whole(self.drawing, drawn)
        except WorkbenchError as error:
            shown = str(error).replace(str(self.copy), str(self.path))
        self.tell(f"{self.frames} frames so far: {one_line(shown)}")


def _drawn(results: Results) -> bytes | None:
    """The measured sections of an inspection, as SVG; None: there is none."""
    from workbench.report.groove_stage import groove_drawing
    from workbench.report.section_drawing import of_interest, section_drawings

    found = next((one for one in results if isinstance(one, JointInspection)), None)
    if isinstance(found, Inspection):
        return section_drawings(results.last(Cloud), results.last(MilledEdge), found)
    if isinstance(found, RecognisedInspection):
        return groove_drawing(results.last(Cloud), results.last(Joint), of_interest(found))
    return None


def _sizes(inspection: JointInspection) -> str:
    """The mean over the sections of each size, with the largest U = 2 u."""
    found = (
        (one.term.lower(), [pair for pair in one.pairs if pair], one.is_angle) for one in inspection.characteristics
    )
    return ", ".join(
        f"{name} {sum(value for value, _ in pairs) / len(pairs):.3f} ± {2 * max(u for _, u in pairs):.3f} "
        + ("°" if is_angle else "mm")
        for name, pairs, is_angle in found
        if pairs
    )


def copy_complete_frames(path: Path, copy: Path, least: int) -> int:
    """Copy the frames of a growing recording that are there whole, with a pose after them; how many, 0 below `least`.

    Raises OSError, RuntimeError, KeyError or ValueError where the file is just being changed, or is no recording.
    """
    import h5py

    with h5py.File(path, "r", libver="latest", swmr=True) as old:
        profiles, robot = dict(old["profiles"].items()), dict(old["robot"].items())
        count = min(len(values) for values in profiles.values())
        poses = min(len(values) for values in robot.values())
        if min(count, poses) < 2:
            return 0
        last = float(robot["time"][poses - 1])
        frames = int(np.searchsorted(profiles["time"][:count] > last, True)) if "pass" not in robot else count
        if frames < least:
            return 0
        room = sum(one.size * one.dtype.itemsize for each in (profiles, robot) for one in each.values())
        with new_hdf5(copy, room) as new:
            new.attrs.update(old.attrs)
            for group, values, length in (("profiles", profiles, frames), ("robot", robot, poses)):
                new.create_group(group).attrs.update(old[group].attrs)
                for name, one in values.items():
                    new[f"{group}/{name}"] = one[:length]
            for name in old:
                if name not in ("profiles", "robot"):
                    old.copy(name, new)
    return frames
