"""Stages that plan the milling path: `path.*`."""

from workbench.path.layers import layers

__all__ = ["layers"]
