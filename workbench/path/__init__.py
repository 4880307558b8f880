"""Stages that plan the milling path: `path.*`."""

from workbench.path.simplify import simplify

__all__ = ["simplify"]
