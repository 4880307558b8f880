"""Stages that write programs for robot controllers: `program.*`."""

from workbench.program.csv import csv
from workbench.program.write import write

__all__ = ["csv", "write"]
