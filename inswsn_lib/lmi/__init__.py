"""Linear matrix inequalities of the H-infinity filters, and the norms that certify them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
