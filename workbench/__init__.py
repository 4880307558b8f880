"""workbench: the point-cloud workbench for robotic bevel milling.

In a notebook: `workbench.read("part.h5")`, then the stages by family, `workbench.scan.fuse`, `workbench.edge.segment`,
`workbench.inspect.sections` and so on; or a pipeline as a whole, `workbench.Pipeline`.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench import api as api
    from workbench import artefacts as artefacts
    from workbench import batch as batch
    from workbench import checks as checks
    from workbench import cloud as cloud
    from workbench import compare as compare
    from workbench import edge as edge
    from workbench import errors as errors
    from workbench import export as export
    from workbench import inspect as inspect
    from workbench import look as look
    from workbench import path as path
    from workbench import program as program
    from workbench import report as report
    from workbench import robot as robot
    from workbench import scan as scan
    from workbench import synthetic as synthetic
    from workbench import twin as twin
    from workbench import view as view
    from workbench.pipeline import Pipeline as Pipeline
    from workbench.pipeline import Results as Results
    from workbench.plugins import calibration as calibrate  # noqa: F401 (a name for users)
    from workbench.plugins import stiffness as stiffness
    from workbench.scan import read as read

__version__ = "0.3.0"
_PLAIN = ("scan", "cloud", "edge", "inspect", "path", "program", "twin", "report", "compare", "export", "robot")
FAMILIES = {  # of stages, and where they are: as the entry points say
    **{name: f"workbench.{name}" for name in _PLAIN},
    "calibrate": "workbench.plugins.calibration",
    "stiffness": "workbench.plugins.stiffness",
}
_OTHERS = ("api", "artefacts", "batch", "checks", "errors", "look", "synthetic", "view")
OTHERS = {name: f"workbench.{name}" for name in _OTHERS}
NAMES = {"Pipeline": "workbench.pipeline", "Results": "workbench.pipeline", "read": "workbench.scan"}
__all__ = ["__version__", *FAMILIES, *OTHERS, *NAMES]


def __getattr__(name: str) -> Any:
    """Import what is for users on first use, so that `import workbench` stays cheap."""
    if name in NAMES:
        return getattr(importlib.import_module(NAMES[name]), name)
    if place := FAMILIES.get(name) or OTHERS.get(name):
        return importlib.import_module(place)
    raise AttributeError(f"module 'workbench' has no attribute {name!r}")


def __dir__() -> list[str]:
    """What is for users, for completion."""
    return sorted(__all__)
