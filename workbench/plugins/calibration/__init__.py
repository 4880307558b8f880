"""Stages of calibration: the hand-eye pose on a sphere, with next postures and validation; tool; turntable; robot."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
