"""Stages that find the edge: `edge.segment`, `edge.segment_cloud` without a grid, `edge.segment_raw` before milling;
`edge.segment_groove`: two plates before welding; `edge.segment_preparation`: one plate prepared as more than a bevel.
"""

from workbench.edge.segment import segment
from workbench.edge.segment_cloud import segment_cloud
from workbench.edge.segment_groove import segment_groove
from workbench.edge.segment_preparation import segment_preparation
from workbench.edge.segment_raw import segment_raw

__all__ = ["segment", "segment_cloud", "segment_groove", "segment_preparation", "segment_raw"]
