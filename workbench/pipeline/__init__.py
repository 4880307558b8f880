"""Pipelines: the document, its wiring, the run and its results."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.pipeline.run import Pipeline, Results

__all__ = ["Pipeline", "Results"]


def __getattr__(name: str) -> Any:
    """Import the run on first use: what only lists stages needs none of it."""
    if name in __all__:
        from workbench.pipeline import run

        return getattr(run, name)
    raise AttributeError(f"module 'workbench.pipeline' has no attribute {name!r}")
