"""Errors: what they can and cannot be, how large they are, and whether a filter knows."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
