"""Stages on clouds: those of other scanners are read, thinned, cropped, registered; recorded ones denoised."""

from workbench.cloud.crop import crop
from workbench.cloud.denoise import denoise
from workbench.cloud.downsample import downsample
from workbench.cloud.read import read
from workbench.cloud.register import register

__all__ = ["crop", "denoise", "downsample", "read", "register"]
