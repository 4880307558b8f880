"""Which file a part of the mapping is about."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

from workbench.importing.mapping import Mapping
from workbench.importing.mapping_formats import ArraysPart, HeightMapPart, JointsPart, StampsPart, TrackerPart
from workbench.importing.mapping_tables import PosesPart, ProfilesPart, RawPart

Named = ProfilesPart | PosesPart | RawPart | HeightMapPart | ArraysPart | JointsPart | StampsPart | TrackerPart


def claims(part: Named | None, path: Path) -> bool:
    """Whether the part names the file by its pattern."""
    return part is not None and part.files is not None and fnmatchcase(path.name, part.files)


def claimed_by(path: Path, mapping: Mapping) -> list[str]:
    """Modules of workbench.importing whose part of the mapping names the file."""
    parts: dict[str, Named | None] = {
        "tables": mapping.profiles,
        "poses": mapping.poses,
        "keyence": mapping.keyence_raw,
        "images": mapping.height_map,
        "arrays": mapping.arrays,
        "joints": mapping.joints,
        "stamps": mapping.stamps,
        "tracker": mapping.tracker,
    }
    return [name for name, part in parts.items() if claims(part, path)]
