"""Stages on clouds: `cloud.denoise`."""

from workbench.cloud.denoise import denoise

__all__ = ["denoise"]
