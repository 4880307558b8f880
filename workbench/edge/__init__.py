"""Stages that find the workpiece's edge: `edge.segment`, and `edge.segment_raw` before it is milled."""

from workbench.edge.segment import segment
from workbench.edge.segment_raw import segment_raw

__all__ = ["segment", "segment_raw"]
