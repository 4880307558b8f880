from .segment_cloud_stage import segment_cloud as segment_cloud
from .segment_groove_stage import segment_groove as segment_groove
from .segment_preparation_stage import segment_preparation as segment_preparation
from .segment_raw_stage import segment_raw as segment_raw
from .segment_stage import segment as segment
