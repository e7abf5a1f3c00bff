"""Logs of your own and known recordings: reading, diagnosing and judging them."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
