"""Reports that a person reads and signs: chapters, the page that binds them, and a table for spreadsheets."""

from workbench.report.closed_loop import closed_loop
from workbench.report.correction import correction
from workbench.report.csv import csv
from workbench.report.groove import groove, preparation
from workbench.report.html import html
from workbench.report.inspection import inspection
from workbench.report.plan import plan
from workbench.report.sensitivity import sensitivity

__all__ = ["closed_loop", "correction", "csv", "groove", "html", "inspection", "plan", "preparation", "sensitivity"]
