"""Stages on clouds: those of other scanners are read and registered; recorded ones denoised."""

from workbench.cloud.denoise import denoise
from workbench.cloud.read import read
from workbench.cloud.register import register

__all__ = ["denoise", "read", "register"]
