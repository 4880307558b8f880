"""The robot's stiffness: its model, its identification, milling forces. Stages `stiffness.*`."""

from workbench.plugins.stiffness.deflection import deflection
from workbench.plugins.stiffness.identify import identify
from workbench.plugins.stiffness.read import read

__all__ = ["deflection", "identify", "read"]
