"""Simulation: a path, a two-dimensional INS, sensor networks with geometry; P1's and P2's scene."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
