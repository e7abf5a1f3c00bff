"""Navigation: P1's training areas, the hybrid of a filter and a regressor, and recordings."""

from inswsn_lib.navigation.bridged_outages import (
    BridgedOutages,
    Judged,
    Passage,
    bridged_outages,
)
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
from inswsn_lib.navigation.training_areas import (
    TrainingAreas,
    errors_by_area,
    noise_sizes,
    table2_cells,
    training_areas,
)
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
    "BridgedOutages",
    "ClusterFusion",
    "HybridNavigator",
    "HybridRun",
    "Judged",
    "Machine",
    "OutageTrials",
    "Passage",
    "Ramps",
    "RecordedTrials",
    "Recording",
    "TrainingAreas",
    "VehicleHybrid",
    "VehicleOutages",
    "bridged_outages",
    "cluster_fusion",
    "errors_by_area",
    "fit_many",
    "noise_sizes",
    "observable_inputs",
    "outage_size",
    "p3_hybrids",
    "planar_rms",
    "read_recording",
    "read_trials",
    "run_outages",
    "run_recorded_outages",
    "sensed_motion",
    "table2_cells",
    "training_areas",
    "vehicle_outages",
    "widen_velocities",
]
