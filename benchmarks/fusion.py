"""How the time to design the weights of a fusion grows with the clusters: `make bench`.

Clusters of three kinds hear the blind node together. The problem in parts is solved for 2 to 512 of
them, certificate included, and held against the problem with a full P and against a solver that
does not know the parts, where that is possible. Times are the best of several repetitions and go to
data/benchmarks-fusion.yaml, with the aims: 128 clusters in 2 s, 512 in 5 times the time of 128, and
no more time for fewer clusters.
"""

from __future__ import annotations

from datetime import UTC, datetime
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml
from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import machine_facts
from throughput import best_of

from inswsn_lib.lmi import FilterDesign, design_filter, design_fusion
from inswsn_lib.lmi.fusion import NOISES
from inswsn_lib.models import ErrorModel

OUT = Path(__file__).parent.parent / "data" / "benchmarks-fusion.yaml"
NUMBERS, FULL, GENERAL = (2, 4, 8, 16, 32, 64, 128, 256, 512), (2, 4, 8), (2, 8, 32)
SECONDS, GROWTH = 2.0, 5.0  # of 128 clusters, and of 512 over 128


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
    design_fusion(clusters(2), structure="block")  # compiles
    for noise in NOISES:
        times = {}
        for count in NUMBERS:
            designs = clusters(count)
            design = partial(design_fusion, designs, noise, "block")
            times[count] = best_of(design, 3 if count <= 128 else 1)
            line = {
                "noise": noise,
                "clusters": str(count),
                "seconds": f"{times[count]:.3g}",
                "over_two": f"{times[count] / times[2]:.3g}",
            }
            if count in FULL:
                full = best_of(partial(design_fusion, designs, noise, "full"), 1)
                line["full_over_block"] = f"{full / times[count]:.3g}"
            if count in GENERAL:
                general = best_of(partial(design, solver="clarabel"), 1)
                line["general_over_block"] = f"{general / times[count]:.3g}"
            out.append(line)
            print(line)
    return out


def aims(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Return what was aimed at for either noise, and whether it was met."""
    out = []
    for noise in NOISES:
        times = {int(r["clusters"]): float(r["seconds"]) for r in rows if r["noise"] == noise}
        falls = [b for a, b in pairwise(NUMBERS) if times[b] < times[a]]
        growth = times[512] / times[128]
        out += [
            told(noise, "seconds of 128 clusters", times[128], SECONDS),
            told(noise, "512 clusters over 128", growth, GROWTH),
            told(noise, "numbers of clusters that take less time than fewer", len(falls), 0),
        ]
    return out


def told(noise: str, what: str, found: float, most: float) -> dict[str, str]:
    """Return an aim, what was found and whether it is at most that."""
    met = "yes" if found <= most else "no"
    return {"noise": noise, "what": what, "found": f"{found:.3g}", "aim": f"{most:g}", "met": met}


if __name__ == "__main__":
    facts = machine_facts()
    content = {
        "machine": f"{facts['cpu']}, {facts['cores']} cores, {facts['system']}, "
        f"Python {facts['python']}, numpy {np.__version__}",
        "date": datetime.now(UTC).date().isoformat(),
        "rows": (timed := rows()),
        "aims": aims(timed),
    }
    head = "# Made by `make bench` (benchmarks/fusion.py); do not edit.\n"
    write_whole(OUT, head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
    print(f"Wrote {OUT.relative_to(OUT.parent.parent)}.")
