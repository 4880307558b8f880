"""Pipelines: the document, its wiring, the run and its results."""

from workbench.pipeline.run import Pipeline, Results

__all__ = ["Pipeline", "Results"]
