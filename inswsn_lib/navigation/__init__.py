"""Navigation: P1's training areas, the hybrid of a filter and a regressor, and recordings."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
