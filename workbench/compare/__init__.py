"""Scans beside scans, meshes and plans; measurements beside measurements: `compare.*`."""

from workbench.compare.repeatability import repeatability
from workbench.compare.study import study

__all__ = ["repeatability", "study"]
