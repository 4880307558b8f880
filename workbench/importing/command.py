"""`workbench import`: other people's files to a profile recording, with what was understood of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Recording
from workbench.errors import InputError, one_line
from workbench.geometry.blocks import evenly
from workbench.geometry.moves import chords_mm
from workbench.importing.assemble import assemble
from workbench.importing.kinds import read_source
from workbench.importing.mapping import Mapping, no_mapping, read_mapping
from workbench.importing.neutral import Imported, returns_of
from workbench.importing.tracker import joined
from workbench.recording_file import write
from workbench.storage import write_whole
from workbench.units import Float32

REFUSED = "scan.fuse refuses it until these lines are taken out of the mapping's list 'uncertain', their values right"
PITCH_FRAMES = 200  # that tell the pitch


class Understood(NamedTuple):
    """A recording (None: a tracker's table) and the lines that say what was understood."""

    recording: Recording | None
    lines: tuple[str, ...]


def import_files(sources: Sequence[str | Path], out: str | Path, mapping: str | Path | None = None) -> Understood:
    """Read all sources as the mapping file says, and write one recording; of a tracker's readings one table.

    Args:
        sources: profile files (a pass each, or a frame each), pose files.
        out: the recording to write, `.h5`, or the table, `.csv`; replaced if it exists, untouched if anything is wrong.
        mapping: MAP.json (docs/importing.md); None: the files must leave no doubt.

    Raises:
        InputError: a source or the mapping cannot be used, with the place and what was expected.
        OutputError: the recording cannot be written.
    """
    target = Path(out)
    _check_names(sources, target)
    chosen = no_mapping() if mapping is None else read_mapping(Path(mapping))
    found = _all_read(sources, chosen)
    read = [f"{source}: {note}" for source, one in zip(sources, found, strict=True) for note in one.notes]
    if target.suffix == ".csv":
        return Understood(None, tuple(one_line(line) for line in (*read, *_tracker_table(found, chosen, target))))
    recording, notes = assemble(found, chosen)
    recording = dataclasses.replace(recording, not_confirmed=tuple(map(one_line, chosen.uncertain)))
    write(recording, target, compression="lzf")
    unsure = [f"lacking: {text}" for text in chosen.lacking]
    unsure += [f"not confirmed: {text}" for text in recording.not_confirmed]
    unsure += [REFUSED] if recording.not_confirmed else []
    return Understood(recording, tuple(one_line(line) for line in (*read, *notes, *summary(recording), *unsure)))


def _tracker_table(found: Sequence[Imported], mapping: Mapping, target: Path) -> tuple[str, ...]:
    """Write the table of a tracker's readings and the robot's postures; lines that say how it came about."""
    if not any(one.tracker is not None for one in found):
        raise InputError(str(target), "expected the name of a recording to write, ending in .h5")
    if mapping.uncertain:
        what = f"is not confirmed: {mapping.uncertain[0]}; a table cannot say so: take the lines out of 'uncertain'"
        raise InputError("mapping", what)
    lines, notes = joined(found, mapping)
    write_whole(target, "\n".join([*lines, ""]).encode())
    return notes


def _all_read(sources: Sequence[str | Path], mapping: Mapping) -> list[Imported]:
    """What each source holds; what is wrong with any of them is told at once."""
    found, errors = [], []
    for source in sources:
        try:
            found.append(read_source(Path(source), mapping))
        except InputError as error:
            errors.append(error)
        except OSError as error:
            errors.append(InputError(str(source), f"cannot be read: {error.strerror or one_line(str(error))}"))
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise InputError("sources", "; ".join(f"({k}) {error}" for k, error in enumerate(errors, 1)))
    return found


def _check_names(sources: Sequence[str | Path], target: Path) -> None:
    if target.suffix not in (".h5", ".csv"):
        raise InputError(str(target), "expected the name of a recording to write, ending in .h5")
    places = [Path(source).resolve() for source in sources]
    if target.resolve() in places:
        raise InputError(str(target), "is one of the sources: expected another name for the recording")
    twice = next((source for i, source in enumerate(sources) if places[i] in places[:i]), None)
    if twice is not None:
        raise InputError(str(twice), "occurs twice among the sources")


def grid_lines(x_mm: Float32, z_mm: Float32) -> list[str]:
    """Frames, columns, pitch, missing share of profiles (N, M), and within what they lie."""
    frames, columns = z_mm.shape
    seen, ranges = returns_of(x_mm, z_mm)
    return [
        f"profiles: {frames} frames of {columns} columns, pitch {column_pitch_mm(x_mm):.4g} mm, "
        f"{100 * (1 - seen / (frames * columns)):.1f} % missing",
        "returns: x {:.4g} to {:.4g} mm, z {:.4g} to {:.4g} mm".format(*ranges.ravel()) if seen else "returns: none",
    ]


def column_pitch_mm(x_mm: Float32) -> float:
    """Median distance of neighbouring columns in some of the profiles (N, M); NaN where nothing tells it."""
    step_mm = np.abs(np.diff(x_mm[evenly(len(x_mm), PITCH_FRAMES)], axis=1))
    step_mm = step_mm[step_mm > 0]
    return float(np.median(step_mm)) if len(step_mm) else float("nan")


def summary(recording: Recording) -> list[str]:
    """Frames, columns, pitch, missing share, duration and travel of a recording."""
    lines = grid_lines(recording.x_mm, recording.z_mm)
    lines[-1] += "" if recording.intensity is None else ", with intensity"
    for number in np.unique(recording.pass_index):
        frame, pose = recording.pass_index == number, recording.robot_pass == number
        time_s, position_mm = recording.time_s[frame], recording.robot_position_mm[pose]
        travel_mm = chords_mm(position_mm).sum()
        lines.append(
            f"pass {number}: {frame.sum()} frames over {np.ptp(time_s):.4g} s, {pose.sum()} poses, "
            f"travel {travel_mm:.4g} mm"
        )
    return lines
