"""The vehicle of P3: its error model, its filter, and drives, made and recorded."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
