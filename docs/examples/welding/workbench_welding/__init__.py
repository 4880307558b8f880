"""The family `weld`: how much weld metal the groove of a measured bevel takes. Of workbench it imports the api only."""

from workbench_welding.gate import gate
from workbench_welding.groove import Groove, GrooveSection, groove
from workbench_welding.report import report

__all__ = ["Groove", "GrooveSection", "gate", "groove", "report"]
