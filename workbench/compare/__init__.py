"""Scans beside scans, meshes and plans; measurements beside measurements: `compare.*`."""

from workbench.compare.deviation import deviation
from workbench.compare.register import register
from workbench.compare.repeatability import repeatability
from workbench.compare.study import study
from workbench.compare.surface import mesh, plan, surface

__all__ = ["deviation", "mesh", "plan", "register", "repeatability", "study", "surface"]
