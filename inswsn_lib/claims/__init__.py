"""What a chapter found: its quantities, the file that keeps them, and how two such files differ."""

from inswsn_lib.claims.comparison import Change, compare, compare_conditions, pair_quantities
from inswsn_lib.claims.record import ChapterRecord
from inswsn_lib.claims.results import Quantity, Results, read_results, write_results
from inswsn_lib.claims.scoreboard import Scoreboard, Statement
from inswsn_lib.claims.verdicts import Verdict, judge_own_cells

__all__ = [
    "Change",
    "ChapterRecord",
    "Quantity",
    "Results",
    "Scoreboard",
    "Statement",
    "Verdict",
    "compare",
    "compare_conditions",
    "judge_own_cells",
    "pair_quantities",
    "read_results",
    "write_results",
]
