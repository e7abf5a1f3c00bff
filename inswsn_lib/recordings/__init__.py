"""Recordings: your own CSV files, and recorded data that are fetched once, by digest."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
