"""The pictures of the front page and of the README: `make publish`.

The papers' methods over their rivals, by the reference results, are kept in data/front.json for the
text of the front page, and drawn in data/front.svg, and on white in data/readme.svg.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import exp, log
from pathlib import Path

from inswsn_book.judge.review import Findings
from inswsn_book.record.files import write_whole
from inswsn_book.record.results import read_results
from inswsn_book.show import svg_of

from inswsn_lib.files import read_yaml
from inswsn_lib.plotting import COLOURS, figure

ROOT = Path(__file__).parent.parent
DATA, PICTURE, README = "data/front.json", "data/front.svg", "data/readme.svg"


@dataclass(frozen=True)
class Contest:
    """The error of a paper's method over that of its rival: printed, rebuilt, and recorded."""

    label: str  # the method over its rival, and what is compared
    printed: float | None  # None if the paper prints no such comparison
    rebuilt: float  # as the book finds it
    recorded: float | None = None
    alike: bool = True  # whether both were given the same, and tuned alike


def contests(root: Path, findings: Findings) -> list[Contest]:
    """Return the comparisons that the papers are about."""
    p2 = read_yaml(root / "data/papers/p2.yaml")["results"]
    p3 = read_yaml(root / "data/papers/p3.yaml")
    value = findings.quotient

    def left(per_cent: Sequence[float]) -> float:
        """Return the geometric mean of what reductions leave."""
        return exp(sum(log(1 - p / 100) for p in per_cent) / len(per_cent))

    p2_left = [
        left([float(p2[c]["vs_fkf"]) for c in pair]) for pair in (("rx", "ry"), ("vx", "vy"))
    ]

    bridged = [
        q.value
        for q in findings.results["printed-numbers"].quantities
        if q.name.startswith("table3.reduction.")
    ]
    average = float(p3["average_improvement_at_least"])
    return [
        Contest("P1: H∞ over Kalman,\nposition",
                1 / value("p1-training", "headline.published-ratio"),
                value("p1-training", "fair.hf-exact-lmi.position", "fair.kalman.position"),
                value("p1-training", "lasting.recorded.hf-tuned-for-white",
                      "lasting.recorded.kalman-tuned-for-white")),
        Contest("P1: LS-SVM over BP,\noutages", left(bridged),
                value("p1-outages", "fair.geometric.ls-svm-motion", "fair.geometric.bp-motion")),
        Contest("P2: distributed H∞ over\nfederated Kalman, position", p2_left[0],
                value("p2-fusion", "fair.dhf-over-fkf.position")),
        Contest("P2: distributed H∞ over\nfederated Kalman, velocity", p2_left[1],
                value("p2-fusion", "fair.dhf-over-fkf.velocity")),
        Contest("P3: aids and LS-SVM\nover Kalman alone", 1 - average / 100,
                value("p3-vehicle", "factor.lssvm-never"),
                value("p3-vehicle", "recorded.factor.lssvm", "recorded.factor.never"), alike=False),
        Contest("P3: LS-SVM with aids\nover aids alone", None, value("p3-vehicle", "methods.lssvm"),
                value("p3-vehicle", "recorded.factor.lssvm")),
    ]  # fmt: skip


def front_svg(rows: Sequence[Contest], **options: str) -> str:
    """Draw the comparisons, as SVG."""
    fig, axes = figure(height=3.9)
    fig.set_size_inches(4.9, 3.9)  # beside the text, where its letters are as large as the text's
    places = range(len(rows) - 1, -1, -1)
    for place, row in zip(places, rows, strict=True):
        if row.printed is not None:
            ends = [row.printed, row.rebuilt]
            axes.plot(ends, [place, place], "-", color="#bbbbbb", lw=1, zorder=1)
    for field, label, marker, colour in (
        ("printed", "as printed", "o", "published"),
        ("rebuilt", "on equal terms", "s", "rebuilt"),
        ("recorded", "on recorded data", "D", "reproduced"),
    ):
        values = [getattr(row, field) for row in rows]  # one that is None is not drawn
        numbers = [float("nan") if value is None else value for value in values]
        axes.plot(numbers, places, marker, ms=8, color=COLOURS[colour], label=label)
    axes.axvline(1, color=COLOURS["contradicted"], lw=1.2)
    axes.set(xscale="log", xlim=(0.05, 4), ylim=(-0.6, len(rows) - 0.4))
    axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1, 2, 4], ["1/20", "1/10", "1/5", "1/2", "1", "2", "4"])
    axes.minorticks_off()
    axes.set_yticks(list(places), [row.label for row in rows])
    axes.set_xlabel("the method's error over its rival's")
    fig.legend(loc="outside upper right", ncols=3, fontsize=9, columnspacing=1, handletextpad=0.2)
    return svg_of(fig, **options)


def main() -> None:
    """Write the numbers and the picture."""
    paths = sorted((ROOT / "data/published").glob("*.json"))
    rows = contests(ROOT, Findings([read_results(path) for path in paths], []))
    numbers = json.dumps([asdict(row) for row in rows], indent=1, ensure_ascii=False)
    write_whole(ROOT / DATA, numbers + "\n")
    write_whole(ROOT / PICTURE, front_svg(rows))
    write_whole(ROOT / README, front_svg(rows, facecolor="white"))


if __name__ == "__main__":
    main()
