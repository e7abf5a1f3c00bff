"""Filters and smoothers of recordings: strapdown or dead reckoning, aided by fixes or ranges."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
