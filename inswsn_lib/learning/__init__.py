"""Regressors that follow the interface of scikit-learn and know nothing of navigation."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
