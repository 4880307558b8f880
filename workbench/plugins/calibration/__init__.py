"""Stages of calibration: the hand-eye pose on a sphere, with next postures and validation; tool; turntable; robot."""

from workbench.plugins.calibration.circles import circles
from workbench.plugins.calibration.hand_eye import hand_eye
from workbench.plugins.calibration.hand_eye_faces import hand_eye_faces
from workbench.plugins.calibration.plan import plan
from workbench.plugins.calibration.report import report
from workbench.plugins.calibration.robot import robot
from workbench.plugins.calibration.tcp import tcp
from workbench.plugins.calibration.tracker import tracker
from workbench.plugins.calibration.turntable import turntable
from workbench.plugins.calibration.validate import validate

__all__ = [
    "circles",
    "hand_eye",
    "hand_eye_faces",
    "plan",
    "report",
    "robot",
    "tcp",
    "tracker",
    "turntable",
    "validate",
]
