"""Stages that plan the milling path: `path.*`."""

from workbench.path.check import check
from workbench.path.check_file import check_file
from workbench.path.correct import correct
from workbench.path.feed import feed
from workbench.path.layers import layers
from workbench.path.read import read
from workbench.path.rework import rework
from workbench.path.simplify import simplify

__all__ = ["check", "check_file", "correct", "feed", "layers", "read", "rework", "simplify"]
