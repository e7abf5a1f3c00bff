from .courses import TRACKS as TRACKS, Course as Course, track_courses as track_courses
from .events import Answer as Answer, Event as Event, Task as Task
from .guards import (
    Disguise as Disguise,
    changed_after as changed_after,
    first_difference as first_difference,
)
from .processes import EntryError as EntryError
from .running import (
    BASELINES as BASELINES,
    Result as Result,
    Scored as Scored,
    compare as compare,
    run as run,
)
from .scoring import mean_ratio as mean_ratio
