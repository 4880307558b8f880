"""Which file a part of the mapping is about."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

from workbench.importing.mapping import Mapping
from workbench.importing.mapping_tables import PosesPart, ProfilesPart, RawPart


def claims(part: ProfilesPart | PosesPart | RawPart | None, path: Path) -> bool:
    """Whether the part names the file by its pattern."""
    return part is not None and part.files is not None and fnmatchcase(path.name, part.files)


def claimed_by(path: Path, mapping: Mapping) -> list[str]:
    """Modules of workbench.importing whose part of the mapping names the file."""
    parts = {"tables": mapping.profiles, "poses": mapping.poses, "keyence": mapping.keyence_raw}
    return [name for name, part in parts.items() if claims(part, path)]
