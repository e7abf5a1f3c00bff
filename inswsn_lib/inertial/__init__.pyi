from .alignment import (
    align as align,
    align_planar as align_planar,
    known_start as known_start,
    level as level,
)
from .earth import Earth as Earth, Ground as Ground, metres as metres
from .error_state import (
    ErrorStateFilter as ErrorStateFilter,
    Innovations as Innovations,
    Solution as Solution,
    Start as Start,
    run_error_state as run_error_state,
)
from .observations import (
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
from .smoothing import smooth as smooth, smooth_with_lag as smooth_with_lag
from .strapdown import (
    ImuNoise as ImuNoise,
    InertialMotion as InertialMotion,
    InertialState as InertialState,
)
