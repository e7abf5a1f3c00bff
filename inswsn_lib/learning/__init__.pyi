from .backprop import BackpropRegressor as BackpropRegressor
from .base import HoldRegressor as HoldRegressor, Regressor as Regressor, Scale as Scale
from .lssvm import LSSVMRegressor as LSSVMRegressor, kernel_matrix as kernel_matrix
from .own import load_regressor as load_regressor
from .rbf_network import RBFNetworkRegressor as RBFNetworkRegressor
from .selection import (
    SelectedLSSVM as SelectedLSSVM,
    Selection as Selection,
    select_lssvm as select_lssvm,
)
