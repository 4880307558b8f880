"""Reports that a person reads and signs: chapters, and the page that binds them."""

from workbench.report.closed_loop import closed_loop
from workbench.report.correction import correction
from workbench.report.groove import groove, preparation
from workbench.report.html import html
from workbench.report.inspection import inspection
from workbench.report.plan import plan
from workbench.report.sensitivity import sensitivity

__all__ = ["closed_loop", "correction", "groove", "html", "inspection", "plan", "preparation", "sensitivity"]
