"""What a mapping file may say about a bag: topics, frames, clock."""

from __future__ import annotations

from workbench.importing.part import Part


class BagPart(Part):
    """Object `bag` of a mapping file."""
