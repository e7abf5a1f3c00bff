"""The pictures of the front page and of the README: `make publish`.

The papers' methods over their rivals, by the reference results, are kept in data/front.json for the
text of the front page, and drawn in data/front.svg. The example of the lessons is drawn in
data/example.svg: what an INS and fixes say of a drive, and a Kalman filter of both.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from math import exp, log
from pathlib import Path

import numpy as np
from inswsn_book.files import write_whole
from inswsn_book.results import read_results
from inswsn_book.review import Findings
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from inswsn_lib.files import read_yaml
from inswsn_lib.filters import run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import example_run
from inswsn_lib.plotting import COLOURS, figure, stroke

ROOT = Path(__file__).parent.parent
DATA, PICTURE, EXAMPLE = "data/front.json", "data/front.svg", "data/example.svg"


@dataclass(frozen=True)
class Contest:
    """The error of a paper's method over that of its rival: printed, rebuilt, and recorded."""

    label: str  # the method over its rival, and what is compared
    printed: float | None  # None if the paper prints no such comparison
    rebuilt: float  # as the book finds it; in the rows of P1 and P2 both are treated alike
    recorded: float | None = None


def contests(root: Path, findings: Findings) -> list[Contest]:
    """Return the comparisons that the papers are about."""
    p2 = read_yaml(root / "data/papers/p2.yaml")["results"]
    p3 = read_yaml(root / "data/papers/p3.yaml")
    value = findings.quotient

    def left(per_cent: Sequence[float]) -> float:
        """Return the geometric mean of what reductions leave."""
        return exp(sum(log(1 - p / 100) for p in per_cent) / len(per_cent))

    bridged = [
        q.value for q in findings.results["00"].quantities if q.name.startswith("table3.reduction.")
    ]
    average = float(p3["average_improvement_at_least"])
    return [
        Contest("P1: HF over KF,\nposition", 1 / value("02", "headline.published-ratio"),
                value("02", "fair.hf-exact-lmi.position", "fair.kalman.position"),
                value("02", "lasting.recorded.hf-tuned-for-white",
                      "lasting.recorded.kalman-tuned-for-white")),
        Contest("P1: LS-SVM over BP,\noutages", left(bridged),
                value("03", "fair.geometric.ls-svm-motion", "fair.geometric.bp-motion")),
        Contest("P2: DHF over FKF,\nposition", left([float(p2[c]["vs_fkf"]) for c in ("rx", "ry")]),
                value("04", "fair.dhf-over-fkf.position")),
        Contest("P2: DHF over FKF,\nvelocity", left([float(p2[c]["vs_fkf"]) for c in ("vx", "vy")]),
                value("04", "fair.dhf-over-fkf.velocity")),
        Contest("P3: proposed over KF", 1 - average / 100, value("05", "factor.lssvm-never"),
                value("05", "recorded.factor.lssvm", "recorded.factor.never")),
        Contest("P3: of that,\nthe LS-SVM", None, value("05", "methods.lssvm"),
                value("05", "recorded.factor.lssvm")),
    ]  # fmt: skip


def front_svg(rows: Sequence[Contest]) -> str:
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
        ("rebuilt", "rebuilt", "s", "rebuilt"),
        ("recorded", "recorded data", "D", "reproduced"),
    ):
        values = [getattr(row, field) for row in rows]  # one that is None is not drawn
        numbers = [float("nan") if value is None else value for value in values]
        axes.plot(numbers, places, marker, ms=8, color=COLOURS[colour], label=label)
    axes.axvline(1, color=COLOURS["contradicted"], lw=1.2)
    axes.set(xscale="log", xlim=(0.05, 4), ylim=(-0.6, len(rows) - 0.4))
    axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1, 2, 4], ["1/20", "1/10", "1/5", "1/2", "1", "2", "4"])
    axes.minorticks_off()
    axes.set_yticks(list(places), [row.label for row in rows])
    axes.set_xlabel("error of the paper's method over its rival's")
    fig.legend(loc="outside upper right", ncols=3, fontsize=9, columnspacing=1, handletextpad=0.2)
    return _svg(fig)


def _svg(fig: Figure, **options: str) -> str:
    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, **options)
    plt.close(fig)
    return stream.getvalue()


def example_svg() -> str:
    """Draw one drive on the map and how far off each is, on white, as SVG."""
    run = example_run()
    model = ErrorModel.p1(run.period, process_noise=run.process, measurement_noise=run.measurement)
    y = run.ins - run.network
    kalman = run.ins - run_kalman(model, y, initial_covariance=1e6 * np.eye(4))
    fig, (track, error) = figure(1, 2, height=2.2)
    shown = {"true path": ("truth", run.truth), "INS": ("ins", run.ins)}
    for label, (method, motion) in shown.items():
        track.plot(*motion[:, :2].T, label=label, **stroke(method))
    track.set(xlabel="x (m)", ylabel="y (m)", title="An INS drifts by metres", aspect="equal")
    track.legend()
    both = {"fixes": ("network", run.network), "Kalman filter": ("kalman", kalman)}
    for label, (method, motion) in both.items():
        dots = {"ls": "", "marker": "o", "ms": 3} if method == "network" else {}
        error.plot(run.time, 100 * run.distances(motion), label=label, **(stroke(method) | dots))
    error.set(xlabel="time (s)", ylabel="off by (cm)", title="Fixes scatter; a filter blends both")
    error.set(ylim=(0, 55))
    error.legend(loc="upper center", ncols=2)
    return _svg(fig, facecolor="white")


def main() -> None:
    """Write the numbers and the picture."""
    paths = sorted((ROOT / "data/published").glob("*.json"))
    rows = contests(ROOT, Findings([read_results(path) for path in paths], []))
    numbers = json.dumps([asdict(row) for row in rows], indent=1, ensure_ascii=False)
    write_whole(ROOT / DATA, numbers + "\n")
    write_whole(ROOT / PICTURE, front_svg(rows))
    write_whole(ROOT / EXAMPLE, example_svg())


if __name__ == "__main__":
    main()
