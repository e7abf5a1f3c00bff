"""Filters that estimate the error of an inertial navigation system."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
