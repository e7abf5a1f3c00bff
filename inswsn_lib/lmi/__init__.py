"""Linear matrix inequalities of the H-infinity filters, and the norms that certify them."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
