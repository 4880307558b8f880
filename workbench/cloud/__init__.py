"""Stages on clouds: `cloud.read` for those of other scanners, `cloud.denoise`."""

from workbench.cloud.denoise import denoise
from workbench.cloud.read import read

__all__ = ["denoise", "read"]
