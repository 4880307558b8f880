"""Clouds, sections and measurements as files that other programs read."""

from workbench.export.cloud import cloud
from workbench.export.inspection import inspection
from workbench.export.qdas import qdas
from workbench.export.qif import qif
from workbench.export.sections import sections

__all__ = ["cloud", "inspection", "qdas", "qif", "sections"]
