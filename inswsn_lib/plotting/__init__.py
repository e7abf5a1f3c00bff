"""One style for all figures and tables, and how a chapter shows them."""

from inswsn_lib.plotting.figures import COLOURS, figure, percent_axis, show_figure
from inswsn_lib.plotting.labs import Choice, Slider, show_lab
from inswsn_lib.plotting.tables import show_parameters, show_table, tick

__all__ = [
    "COLOURS",
    "Choice",
    "Slider",
    "figure",
    "percent_axis",
    "show_figure",
    "show_lab",
    "show_parameters",
    "show_table",
    "tick",
]
