"""Navigation: the hybrid of a filter and a regressor, and recordings to run it on."""

from inswsn_lib.navigation.cluster_fusion import (
    ClusterFusion,
    cluster_fusion,
    planar_rms,
    widen_velocities,
)
from inswsn_lib.navigation.hybrid import (
    HybridNavigator,
    HybridRun,
    fit_many,
    observable_inputs,
)
from inswsn_lib.navigation.recorded_trials import RecordedTrials, read_trials, run_recorded_outages
from inswsn_lib.navigation.recordings import INS, REFERENCE, TIME, WSN, Recording, read_recording
from inswsn_lib.navigation.trials import (
    FILTERS,
    OutageTrials,
    outage_size,
    p3_hybrids,
    run_outages,
)
from inswsn_lib.navigation.vehicle_hybrid import (
    Bridge,
    Machine,
    Ramps,
    VehicleHybrid,
    sensed_motion,
)
from inswsn_lib.navigation.vehicle_outages import VehicleOutages, vehicle_outages

__all__ = [
    "FILTERS",
    "INS",
    "REFERENCE",
    "TIME",
    "WSN",
    "Bridge",
    "ClusterFusion",
    "HybridNavigator",
    "HybridRun",
    "Machine",
    "OutageTrials",
    "Ramps",
    "RecordedTrials",
    "Recording",
    "VehicleHybrid",
    "VehicleOutages",
    "cluster_fusion",
    "fit_many",
    "observable_inputs",
    "outage_size",
    "p3_hybrids",
    "planar_rms",
    "read_recording",
    "read_trials",
    "run_outages",
    "run_recorded_outages",
    "sensed_motion",
    "vehicle_outages",
    "widen_velocities",
]
