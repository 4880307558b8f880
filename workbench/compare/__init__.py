"""Scans beside scans, meshes and plans; measurements beside measurements: `compare.*`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
