"""Regressors that follow the interface of scikit-learn and know nothing of navigation."""

from inswsn_lib.extras import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
