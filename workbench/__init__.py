"""workbench: the point-cloud workbench for robotic bevel milling."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.pipeline import Pipeline as Pipeline

__version__ = "0.1.0"
__all__ = ["Pipeline", "__version__"]


def __getattr__(name: str) -> Any:
    """Import `Pipeline` on first use, so that `import workbench` stays cheap."""
    if name == "Pipeline":
        from workbench.pipeline import Pipeline

        return Pipeline
    raise AttributeError(f"module 'workbench' has no attribute {name!r}")
