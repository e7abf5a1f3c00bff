"""Figures: one style that reads on light and dark pages."""

from inswsn_lib.plotting.figures import COLOURS, figure, percent_axis
from inswsn_lib.plotting.scores import draw_scores

__all__ = ["COLOURS", "draw_scores", "figure", "percent_axis"]
