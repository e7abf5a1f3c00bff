"""One style for all figures."""

from inswsn_lib.plotting.figures import COLOURS, figure, percent_axis

__all__ = ["COLOURS", "figure", "percent_axis"]
