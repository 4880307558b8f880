"""Reports that a person reads and signs: chapters, and the page that binds them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
