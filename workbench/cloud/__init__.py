"""Stages on clouds: those of other scanners are read and registered; recorded ones denoised."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
