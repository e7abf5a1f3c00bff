"""Filters and smoothers of recordings: strapdown or dead reckoning, aided by fixes or ranges."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
