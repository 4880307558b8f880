"""What kind of file a source is: one reader per kind, asked in turn."""

from __future__ import annotations

import importlib
import os
from dataclasses import replace
from pathlib import Path
from typing import Protocol, cast

from workbench import force_file
from workbench.errors import InputError
from workbench.importing import joints, poses, tables, tracker
from workbench.importing.mapping import Mapping, claimed_by
from workbench.importing.mapping_parts import TextPart
from workbench.importing.neutral import Imported
from workbench.importing.text import first_bytes, form_of, head_text, otherwise_separated, why_no_table
from workbench.storage import regular_file

KINDS = (  # modules of workbench.importing
    "gocator",
    "scancontrol",
    "arrays",
    "tables",
    "poses",
    "joints",
    "tracker",
    "programs",
    "opencv",
)
BOTH = {"tracker", "joints"}  # that one file may hold
CLOUDS = (".ply", ".pcd", ".las", ".laz", ".e57", ".stl", ".obj", ".xyz")
NUMBERS = (".npy", ".tif", ".tiff", ".png", ".mat", ".bin", ".raw")
BAGS = (".bag", ".db3", ".mcap")
AS_TABLES = "a bag of ROS: a few lines of Python make tables of its profiles and poses (docs/importing.md#other-forms)"
AS_ARRAYS = "a few lines of Python make arrays of it (docs/importing.md#other-forms)"
AS_A_CLOUD = (
    "it is a cloud, and nothing of it goes into a recording: workbench run pipelines/inspect_cloud.json "
    "--input cloud=FILE, with --input unit=m where it is in metres (docs/clouds.md)"
)


class Reader(Protocol):
    """A module that reads one kind of source."""

    NAME: str  # for people: "scanCONTROL profiles"

    def recognises(self, path: Path, head: bytes, mapping: Mapping) -> bool:
        """Whether the source is of this kind: by its name, its first bytes or the mapping."""

    def read(self, path: Path, mapping: Mapping) -> Imported:
        """Its contents; InputError with the place and what was expected."""


def read_source(path: Path, mapping: Mapping) -> Imported:
    """Read one source by the only kind that recognises it.

    Raises:
        InputError: no such file, none or several kinds recognise it, or it cannot be read.
    """
    check_file(path)
    head = first_bytes(path)
    named = claimed_by(path, mapping)  # what the mapping says goes before what the file looks like
    readers = [cast(Reader, importlib.import_module(f"workbench.importing.{name}")) for name in named or KINDS]
    found = [reader for reader in readers if reader.recognises(path, head, mapping)]
    if set(named) == BOTH:  # a table of places and joints
        readings, robot = tracker.read(path, mapping), joints.read(path, mapping)
        return replace(robot, tracker=readings.tracker, notes=(*readings.notes, *robot.notes))
    if len(found) != 1:
        if found:
            names = ", ".join(reader.NAME for reader in found)
            raise InputError(str(path), f"may be {names}: name it by 'files' in the mapping (docs/importing.md)")
        if other := _other(path, head) or _otherwise_separated(head, mapping):
            raise InputError(str(path), other)
        if why := why_no_table(head):
            raise InputError(str(path), f"is no table of numbers: {why}")
        raise InputError(str(path), f"is in no known form (docs/importing.md){_advice(path, head, mapping)}")
    return found[0].read(path, mapping)


def _advice(path: Path, head: bytes, mapping: Mapping) -> str:
    """What the mapping's patterns are; of a table that nothing is known of, how a mapping begins; the first line."""
    named = [f"'{one.files}' of {name}" for name, one in mapping.of_files.items() if one.files is not None]
    if named:
        told = f"; by its name it is none of the mapping's files: {', '.join(named)}"
    else:
        told = f": `workbench import --draft {path}` begins a mapping" if form_of(path) is not None else ""
    return f"{told}; its first line: {head_text(head).split(chr(10), 1)[0][:60]!r}"


def check_file(path: Path) -> None:
    """Refuse what is no file, and a bag, as a file or as the folder that rosbag2 makes."""
    if not os.path.isfile(path / "metadata.yaml"):  # False of a name that is too long, too
        regular_file(path)
        if path.suffix.lower() not in BAGS:
            return
    raise InputError(str(path), AS_TABLES)


def _other(path: Path, head: bytes) -> str:
    """What a file is that is no source of a recording, and where it goes; '' where nothing is known of it."""
    if path.suffix.lower() in CLOUDS:
        return AS_A_CLOUD
    if path.suffix.lower() == ".json":
        mapping = b'"import-mapping"' in head
        return "is a mapping, no source: give it by --mapping" if mapping else "is JSON, in no form that holds profiles"
    if head.startswith(b"\x89HDF"):
        return "is HDF5: a recording already? `workbench look` shows what it holds"
    text = head_text(head)
    sick = "<icon_data_format" in text or (path.suffix.lower() == ".dat" and "\0" in text)
    if sick or path.suffix.lower() in NUMBERS or text[:3].lower() in ("y/x", "y\\x"):
        return f"heights or arrays without a form of their own: {AS_ARRAYS}"
    return f"{force_file.NAME}: forces over time, no recording" if force_file.recognises(text) else ""


def _otherwise_separated(head: bytes, mapping: Mapping) -> str:
    """What to say where a table would be one that the mapping, or a known header, means but for its delimiter."""
    meant = [part for part in (mapping.profiles, mapping.poses, mapping.joints) if part is not None]
    known: list[TextPart] = [*meant] or [*tables.KNOWN.values(), *poses.KNOWN.values()]
    return next((message for part in known if part.wanted and (message := otherwise_separated(head, part))), "")
