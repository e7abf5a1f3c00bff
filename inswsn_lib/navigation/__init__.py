"""Navigation: P1's training areas, and the hybrid of a filter and a regressor."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
