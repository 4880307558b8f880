"""Stages of the hand-eye calibration on a sphere: `calibrate.circles`, `calibrate.hand_eye`."""

from workbench.plugins.calibration.circles import circles
from workbench.plugins.calibration.hand_eye import hand_eye

__all__ = ["circles", "hand_eye"]
