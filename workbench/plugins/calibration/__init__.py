"""Stages of the hand-eye calibration on a sphere: circles, the hand-eye pose, the next postures, validation, report."""

from workbench.plugins.calibration.circles import circles
from workbench.plugins.calibration.hand_eye import hand_eye
from workbench.plugins.calibration.plan import plan
from workbench.plugins.calibration.report import report
from workbench.plugins.calibration.validate import validate

__all__ = ["circles", "hand_eye", "plan", "report", "validate"]
