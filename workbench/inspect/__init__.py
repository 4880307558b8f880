"""Stages that judge: a milled edge by `inspect.sections` and `inspect.gate`, a groove by `inspect.groove`."""

from workbench.inspect.gate import gate
from workbench.inspect.groove import groove, groove_gate
from workbench.inspect.sections import sections

__all__ = ["gate", "groove", "groove_gate", "sections"]
