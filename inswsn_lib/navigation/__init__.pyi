from .bridged_outages import (
    BridgedOutages as BridgedOutages,
    Judged as Judged,
    Passage as Passage,
    with_outage as with_outage,
)
from .cluster_fusion import (
    ClusterFusion as ClusterFusion,
    planar_rms as planar_rms,
    widen_velocities as widen_velocities,
)
from .example import (
    ExampleDrive as ExampleDrive,
    ExampleRun as ExampleRun,
    example_clusters as example_clusters,
    example_drive as example_drive,
    example_run as example_run,
)
from .filter_contest import (
    CONTESTANTS as CONTESTANTS,
    FilterContest as FilterContest,
    relative_errors as relative_errors,
    relative_loss as relative_loss,
    run_wandering as run_wandering,
)
from .hybrid import (
    HybridNavigator as HybridNavigator,
    HybridRun as HybridRun,
    observable_inputs as observable_inputs,
)
from .lmi_designs import LMIDesigns as LMIDesigns, gain_and_error as gain_and_error
from .recorded_study import (
    LearnerSetting as LearnerSetting,
    RecordedClusters as RecordedClusters,
    RecordedOutages as RecordedOutages,
    RecordedStudy as RecordedStudy,
    read_tables as read_tables,
    write_tables as write_tables,
)
from .recorded_trials import (
    RecordedTrials as RecordedTrials,
    read_trials as read_trials,
    run_recorded_outages as run_recorded_outages,
)
from .training_areas import (
    TrainingAreas as TrainingAreas,
    errors_by_area as errors_by_area,
    first_measured as first_measured,
    noise_sizes as noise_sizes,
    run_coloured as run_coloured,
    table2_cells as table2_cells,
    table2_findings as table2_findings,
)
from .vehicle_hybrid import (
    Bridge as Bridge,
    Machine as Machine,
    Ramps as Ramps,
    VehicleHybrid as VehicleHybrid,
    sensed_motion as sensed_motion,
)
from .vehicle_outages import (
    FILTERS as FILTERS,
    RUNGS as RUNGS,
    OutageTrials as OutageTrials,
    VehicleOutages as VehicleOutages,
    outage_size as outage_size,
    p3_hybrids as p3_hybrids,
    run_ladder as run_ladder,
    run_outages as run_outages,
    with_aids as with_aids,
    with_wheels as with_wheels,
)
