"""workbench: the point-cloud workbench for robotic bevel milling.

In a notebook: `workbench.read("part.h5")`, then the stages by family, `workbench.scan.fuse`, `workbench.edge.segment`,
`workbench.inspect.sections` and so on; or a pipeline as a whole, `workbench.Pipeline`.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.pipeline import Pipeline as Pipeline
    from workbench.scan import read as read

__version__ = "0.2.0"
FAMILIES = ("scan", "cloud", "edge", "inspect", "path", "program", "twin", "report", "compare", "export")
__all__ = ["Pipeline", "__version__", "read", *FAMILIES]


def __getattr__(name: str) -> Any:
    """Import `Pipeline`, `read` and the families of stages on first use, so that `import workbench` stays cheap."""
    if name == "Pipeline":
        from workbench.pipeline import Pipeline

        return Pipeline
    if name == "read":
        from workbench.scan import read

        return read
    if name in FAMILIES:
        return importlib.import_module(f"workbench.{name}")
    raise AttributeError(f"module 'workbench' has no attribute {name!r}")


def __dir__() -> list[str]:
    """What is for users, for completion."""
    return sorted(__all__)
