from .figures import COLOURS as COLOURS, figure as figure, percent_axis as percent_axis
from .scores import draw_scores as draw_scores
