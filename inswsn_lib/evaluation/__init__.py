"""Errors: what they can and cannot be, how large they are, and whether a filter knows."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
