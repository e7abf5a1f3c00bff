"""Simulation: a path, a two-dimensional INS, sensor networks with geometry; P1's and P2's scene."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
