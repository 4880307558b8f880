"""Many parts: one run per part, and the page of the fleet."""

from workbench.batch.run import Batch, run_batch

__all__ = ["Batch", "run_batch"]
