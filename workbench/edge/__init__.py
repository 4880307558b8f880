"""Stages that find the edge: `edge.segment`, `edge.segment_cloud` without a grid, `edge.segment_raw` before milling;
`edge.segment_groove`: two plates before welding; `edge.segment_preparation`: one plate prepared as more than a bevel.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
