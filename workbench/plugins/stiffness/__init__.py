"""The robot's stiffness: its model, its identification, milling forces. Stages `stiffness.*`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
