from .adapting import as_multi_output as as_multi_output
from .backprop import BackpropRegressor as BackpropRegressor
from .lssvm import LSSVMRegressor as LSSVMRegressor
from .named import load_regressor as load_regressor
from .rbf_network import RBFNetworkRegressor as RBFNetworkRegressor
from .scaling import Scale as Scale
from .selected import HoldRegressor as HoldRegressor, SelectedLSSVM as SelectedLSSVM
from .selection import (
    Selection as Selection,
    leave_one_out as leave_one_out,
    select_lssvm as select_lssvm,
)
