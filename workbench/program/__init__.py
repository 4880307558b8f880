"""Stages that write programs for robot controllers: `program.*`."""

from workbench.program.csv import csv
from workbench.program.krl import krl
from workbench.program.rapid import rapid

__all__ = ["csv", "krl", "rapid"]
