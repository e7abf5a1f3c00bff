"""Filters and smoothers over recordings: strapdown or dead reckoning, fixes or ranges, late or not."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
