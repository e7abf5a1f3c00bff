"""Regressors that follow the interface of scikit-learn and know nothing of navigation."""

from inswsn_lib.learning.adapting import as_multi_output
from inswsn_lib.learning.backprop import BackpropRegressor
from inswsn_lib.learning.lssvm import LSSVMRegressor
from inswsn_lib.learning.rbf_network import RBFNetworkRegressor
from inswsn_lib.learning.selected import HoldRegressor, SelectedLSSVM
from inswsn_lib.learning.selection import Selection, leave_one_out, select_lssvm

__all__ = [
    "BackpropRegressor",
    "HoldRegressor",
    "LSSVMRegressor",
    "RBFNetworkRegressor",
    "SelectedLSSVM",
    "Selection",
    "as_multi_output",
    "leave_one_out",
    "select_lssvm",
]
