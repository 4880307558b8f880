"""Reading profile recordings and fusing them into one organised cloud: the stages `scan.read` and `scan.fuse`."""

from workbench.recording_file import write
from workbench.scan.checks import read_hand_eye
from workbench.scan.fuse_stage import fuse
from workbench.scan.read_stage import read

__all__ = ["fuse", "read", "read_hand_eye", "write"]
