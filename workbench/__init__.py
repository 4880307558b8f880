"""workbench: the point-cloud workbench for robotic bevel milling.

In a notebook: `workbench.read("part.h5")`, then the stages by family, `workbench.scan.fuse`, `workbench.edge.segment`,
`workbench.inspect.sections` and so on; or a pipeline as a whole, `workbench.Pipeline`.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.pipeline import Pipeline as Pipeline
    from workbench.pipeline import Results as Results
    from workbench.scan import read as read

__version__ = "0.2.0"
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
