"""Stages that find the workpiece's edge: `edge.segment`."""

from workbench.edge.segment import segment

__all__ = ["segment"]
