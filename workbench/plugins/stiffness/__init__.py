"""The robot's stiffness: its model, its identification, milling forces. Stages `stiffness.*`."""

from workbench.plugins.stiffness.chatter import chatter
from workbench.plugins.stiffness.compensate import compensate
from workbench.plugins.stiffness.deflection import deflection
from workbench.plugins.stiffness.force import force
from workbench.plugins.stiffness.identify import identify
from workbench.plugins.stiffness.identify_forces import identify_forces
from workbench.plugins.stiffness.maps import maps
from workbench.plugins.stiffness.modes import modes
from workbench.plugins.stiffness.plan_loads import plan_loads
from workbench.plugins.stiffness.posture import posture
from workbench.plugins.stiffness.predict import predict
from workbench.plugins.stiffness.read import read
from workbench.plugins.stiffness.simulate_loads import simulate_loads

__all__ = [
    "chatter",
    "compensate",
    "deflection",
    "force",
    "identify",
    "identify_forces",
    "maps",
    "modes",
    "plan_loads",
    "posture",
    "predict",
    "read",
    "simulate_loads",
]
