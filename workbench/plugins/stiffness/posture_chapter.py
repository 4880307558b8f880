"""Postures as a chapter of the report."""

from workbench.api import Cell, Chapter
from workbench.plugins.stiffness.standing import Found


def posture_chapter(cell: Cell, found: Found) -> Chapter:
    """Map, robot before and after, displacement along the path."""
    return Chapter("Postures", "<p></p>")
