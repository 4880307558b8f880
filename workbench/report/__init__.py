"""Reports that a person reads and signs: the stages `report.html` and `report.csv`."""

from workbench.report.csv import csv
from workbench.report.html import html

__all__ = ["csv", "html"]
