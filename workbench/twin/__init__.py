"""Stages of the simulated cell, whose truth is known: `twin.part`, `twin.teach`, `twin.mill`, `twin.scan`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
