"""What the papers claim, what a chapter found, and the verdicts that follow from the two."""

from inswsn_lib.claims.comparison import (
    Change,
    Flip,
    compare,
    compare_conditions,
    flipped_verdicts,
    pair_quantities,
)
from inswsn_lib.claims.ledger import (
    KINDS,
    LEDGER,
    PAPERS,
    Claim,
    MissingCheck,
    QuantityCheck,
    claims_of,
    data_digest,
    load_claims,
)
from inswsn_lib.claims.record import ChapterRecord
from inswsn_lib.claims.results import (
    SCHEMA_VERSION,
    Provenance,
    Quantity,
    Results,
    read_results,
    write_results,
)
from inswsn_lib.claims.verdicts import (
    Judged,
    Verdict,
    count_verdicts,
    judge_own_cells,
    judge_rebuilt,
    verdicts,
)

__all__ = [
    "KINDS",
    "LEDGER",
    "PAPERS",
    "SCHEMA_VERSION",
    "Change",
    "ChapterRecord",
    "Claim",
    "Flip",
    "Judged",
    "MissingCheck",
    "Provenance",
    "Quantity",
    "QuantityCheck",
    "Results",
    "Verdict",
    "claims_of",
    "compare",
    "compare_conditions",
    "count_verdicts",
    "data_digest",
    "flipped_verdicts",
    "judge_own_cells",
    "judge_rebuilt",
    "load_claims",
    "pair_quantities",
    "read_results",
    "verdicts",
    "write_results",
]
