"""Stages that judge: a milled edge by `inspect.sections` and `inspect.gate`, a groove by `inspect.groove`,
the prepared edge of one plate by `inspect.preparation`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
