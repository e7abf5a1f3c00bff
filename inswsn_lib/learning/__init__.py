"""Regressors that follow the interface of scikit-learn and know nothing of navigation."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from inswsn_lib.learning.adapting import as_multi_output
from inswsn_lib.learning.lssvm import LSSVMRegressor
from inswsn_lib.learning.named import load_regressor
from inswsn_lib.learning.rbf_network import RBFNetworkRegressor
from inswsn_lib.learning.selected import HoldRegressor, SelectedLSSVM
from inswsn_lib.learning.selection import Selection, leave_one_out, select_lssvm

if TYPE_CHECKING:
    from inswsn_lib.learning.backprop import BackpropRegressor

__all__ = [
    "BackpropRegressor",
    "HoldRegressor",
    "LSSVMRegressor",
    "RBFNetworkRegressor",
    "SelectedLSSVM",
    "Selection",
    "as_multi_output",
    "leave_one_out",
    "load_regressor",
    "select_lssvm",
]


def __getattr__(name: str) -> Any:
    # the network alone needs torch, which takes seconds to import and is not to be had everywhere
    if name == "BackpropRegressor":
        return import_module("inswsn_lib.learning.backprop").BackpropRegressor
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
