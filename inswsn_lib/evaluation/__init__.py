"""What errors can and cannot do: bounds that hold whatever the data were."""

from inswsn_lib.evaluation.drift import MOTIONS, DriftBound, Motion, drift_bound, longest_period

__all__ = ["MOTIONS", "DriftBound", "Motion", "drift_bound", "longest_period"]
