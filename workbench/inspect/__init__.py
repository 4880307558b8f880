"""Stages that judge: a milled edge by `inspect.sections` and `inspect.gate`, a groove by `inspect.groove`,
the prepared edge of one plate by `inspect.preparation`.
"""

from workbench.inspect.gate import gate
from workbench.inspect.groove import groove, groove_gate, preparation
from workbench.inspect.sections import sections

__all__ = ["gate", "groove", "groove_gate", "preparation", "sections"]
