"""Navigation: P1's training areas, and the hybrid of a filter and a regressor."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
