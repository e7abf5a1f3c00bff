from .alignment import align as align, known_start as known_start, level as level
from .earth import Earth as Earth, Ground as Ground
from .error_state import (
    ErrorStateFilter as ErrorStateFilter,
    Innovations as Innovations,
    Solution as Solution,
    Start as Start,
    run_error_state as run_error_state,
)
from .fix_velocities import slope_velocity as slope_velocity
from .inertial import (
    ImuNoise as ImuNoise,
    InertialMotion as InertialMotion,
    InertialState as InertialState,
)
from .observations import (
    Headings as Headings,
    Innovation as Innovation,
    Observation as Observation,
    PositionFixes as PositionFixes,
    RangesToAnchors as RangesToAnchors,
    Sensor as Sensor,
    Velocities as Velocities,
    WheelSpeeds as WheelSpeeds,
    gauss_markov as gauss_markov,
)
from .planar import (
    OdometryMotion as OdometryMotion,
    OdometryNoise as OdometryNoise,
    PlanarState as PlanarState,
)
from .planar_alignment import align_planar as align_planar
from .range_fixes import multilaterate_track as multilaterate_track
from .smoothing import smooth as smooth, smooth_with_lag as smooth_with_lag
