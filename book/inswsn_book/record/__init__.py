"""What a checkout holds, what a chapter records in a run, and the files that keep it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
