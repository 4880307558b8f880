from .check_file_stage import check_file as check_file
from .check_stage import check as check
from .correct_stage import correct as correct
from .feed_stage import feed as feed
from .layers_stage import layers as layers
from .read_stage import read as read
from .rework_stage import rework as rework
from .simplify_stage import simplify as simplify
