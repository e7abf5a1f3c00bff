"""How the time to design the weights of a fusion grows with the clusters: `make bench`.

Clusters of three kinds hear the blind node together. The decomposed problem is solved for 2 to 128
of them, and against the problem with a full P where that is possible. Times are the best of several
repetitions and go to data/benchmarks-fusion.yaml as ratios.
"""

from __future__ import annotations

from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
import yaml
from inswsn_book.files import write_whole
from inswsn_book.provenance import machine_facts
from throughput import best_of

from inswsn_lib.lmi import FilterDesign, design_filter, design_fusion
from inswsn_lib.models import ErrorModel

OUT = Path(__file__).parent.parent / "data" / "benchmarks-fusion.yaml"
NUMBERS, FULL = (2, 4, 8, 16, 32, 64, 128), (2, 4, 8)


def clusters(count: int) -> list[FilterDesign]:
    """Return filters of clusters with 0.7, 1 and 1.4 times the usual noise, in turn."""
    kinds = [
        design_filter(
            ErrorModel.p1(0.02, process_noise=(1e-4, 0.01), measurement_noise=(0.14 * f, 0.2 * f))
        )
        for f in (0.7, 1.0, 1.4)
    ]
    return [kinds[i % 3] for i in range(count)]


def rows() -> list[dict[str, str]]:
    """Time all designs."""
    out = []
    for noise in ("common", "independent"):
        times = {}
        for count in NUMBERS:
            designs = clusters(count)
            repeats = 3 if count <= 32 else 2
            times[count] = best_of(partial(design_fusion, designs, noise, "block"), repeats)
            line = {
                "noise": noise,
                "clusters": str(count),
                "seconds": f"{times[count]:.3g}",
                "over_two": f"{times[count] / times[2]:.3g}",
            }
            if count in FULL:
                full = best_of(partial(design_fusion, designs, noise, "full"), 1)
                line["full_over_block"] = f"{full / times[count]:.3g}"
            out.append(line)
            print(line)
    return out


if __name__ == "__main__":
    facts = machine_facts()
    content = {
        "machine": f"{facts['cpu']}, {facts['cores']} cores, {facts['system']}, "
        f"Python {facts['python']}, numpy {np.__version__}",
        "date": datetime.now(UTC).date().isoformat(),
        "rows": rows(),
    }
    head = "# Made by `make bench` (benchmarks/fusion.py); do not edit.\n"
    write_whole(OUT, head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
    print(f"Wrote {OUT.relative_to(OUT.parent.parent)}.")
