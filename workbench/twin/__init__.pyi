from .mill_stage import mill as mill
from .part_stage import part as part
from .scan_stage import scan as scan
from .teach_stage import teach as teach
