"""Stages that judge a milled edge: `inspect.sections` and `inspect.gate`."""

from workbench.inspect.gate import gate
from workbench.inspect.sections import sections

__all__ = ["gate", "sections"]
