"""The vehicle of P3: its error model, its filter, and drives, made and recorded."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
