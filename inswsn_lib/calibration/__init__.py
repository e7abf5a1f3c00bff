"""Clocks, frames, lever arms and the errors of ranges, estimated against a reference."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
