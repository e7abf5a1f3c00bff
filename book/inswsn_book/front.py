"""What the front page draws and lists: the papers' contests in one picture, heads of chapters."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import Any

from inswsn_book.project import Chapter
from inswsn_book.results import Results
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

# the chapters whose results the picture draws
_DRAWN = {"00", "02", "03", "04", "05"}
_HEAD = re.compile(
    r"\*\*You need\*\*\s+(?P<need>.*?)\.\s+\*\*Reading time\*\*\s+(?P<minutes>\d+)\s+minutes?\.",
    re.DOTALL,
)


@dataclass(frozen=True)
class Contest:
    """The error of a paper's method over that of its rival, as printed and as rebuilt.

    Attributes
    ----------
    label : str
        The method over its rival, and what is compared.
    printed : float or None
        By the paper's printed numbers; None if it prints no such comparison.
    rebuilt : float
        As the book finds it when both are treated alike.
    recorded : float or None
        The same on recorded data.
    """

    label: str
    printed: float | None
    rebuilt: float
    recorded: float | None = None


def contests(root: Path, results: Mapping[str, Results]) -> list[Contest]:
    """Return the comparisons that the papers are about; none without the chapters that have them.

    Parameters
    ----------
    root : Path
        The checkout, for the printed numbers below ``data/papers``.
    results : mapping of str to Results
        By chapter.

    Raises
    ------
    InswsnError
        If a chapter has no such quantity.
    """
    if not results.keys() >= _DRAWN:
        return []
    p2 = read_yaml(root / "data/papers/p2.yaml")["results"]
    p3 = read_yaml(root / "data/papers/p3.yaml")

    def value(chapter: str, name: str) -> float:
        try:
            return results[chapter][name].value
        except KeyError:
            raise InswsnError(
                f"The front page draws {name} of chapter {chapter}, which records no such quantity."
            ) from None

    def left(per_cent: Sequence[float]) -> float:
        """Return the geometric mean of what reductions leave."""
        return exp(sum(log(1 - p / 100) for p in per_cent) / len(per_cent))

    bridged = [q.value for q in results["00"].quantities if q.name.startswith("table3.reduction.")]
    return [
        Contest(
            "P1: HF over KF,\nposition",
            1 / value("02", "headline.published-ratio"),
            value("02", "fair.hf-exact-lmi.position") / value("02", "fair.kalman.position"),
        ),
        Contest(
            "P1: LS-SVM over BP,\noutages",
            left(bridged),
            value("03", "fair.geometric.ls-svm-motion") / value("03", "fair.geometric.bp-motion"),
        ),
        Contest(
            "P2: DHF over FKF,\nposition",
            left([float(p2[c]["vs_fkf"]) for c in ("rx", "ry")]),
            value("04", "fair.dhf-over-fkf.position"),
        ),
        Contest(
            "P2: DHF over FKF,\nvelocity",
            left([float(p2[c]["vs_fkf"]) for c in ("vx", "vy")]),
            value("04", "fair.dhf-over-fkf.velocity"),
        ),
        Contest(
            "P3: proposed over KF",
            1 - float(p3["average_improvement_at_least"]) / 100,
            value("05", "factor.lssvm-never"),
            value("05", "recorded.factor.lssvm") / value("05", "recorded.factor.never"),
        ),
        Contest(
            "P3: of that,\nthe LS-SVM",
            None,
            value("05", "methods.lssvm"),
            value("05", "recorded.factor.lssvm"),
        ),
    ]


def front_svg(rows: Sequence[Contest]) -> str:
    """Draw the comparisons."""
    from inswsn_lib.plotting import COLOURS, figure  # noqa: PLC0415  # a list needs no figure

    fig, axes = figure(height=3.9)
    fig.set_size_inches(4.9, 3.9)  # beside the text, where its letters are as large as the text's
    places = range(len(rows) - 1, -1, -1)
    for place, row in zip(places, rows, strict=True):
        if row.printed is not None:
            ends = [row.printed, row.rebuilt]
            axes.plot(ends, [place, place], "-", color="#bbbbbb", lw=1, zorder=1)
    drawn: list[tuple[str, str, str, list[tuple[float, int]]]] = [
        (
            "as printed",
            "o",
            "published",
            [(r.printed, p) for p, r in zip(places, rows, strict=True) if r.printed is not None],
        ),
        (
            "on equal terms",
            "s",
            "rebuilt",
            [(r.rebuilt, p) for p, r in zip(places, rows, strict=True)],
        ),
        (
            "on a recorded drive",
            "D",
            "reproduced",
            [(r.recorded, p) for p, r in zip(places, rows, strict=True) if r.recorded is not None],
        ),
    ]
    for label, marker, colour, points in drawn:
        axes.plot(*zip(*points, strict=True), marker, ms=8, color=COLOURS[colour], label=label)
    axes.axvline(1, color=COLOURS["contradicted"], lw=1.2)
    axes.set(xscale="log", xlim=(0.05, 4), ylim=(-0.6, len(rows) - 0.4))
    axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1, 2, 4], ["1/20", "1/10", "1/5", "1/2", "1", "2", "4"])
    axes.minorticks_off()
    axes.set_yticks(list(places), [row.label for row in rows])
    axes.set_xlabel("error of the paper's method over its rival's")
    fig.legend(loc="outside upper right", ncols=3, fontsize=9, columnspacing=1, handletextpad=0.2)
    return _svg(fig)


def _svg(fig: Any) -> str:
    from matplotlib import pyplot as plt  # noqa: PLC0415

    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(fig)
    return stream.getvalue()


def chapter_head(chapter: Chapter) -> tuple[str, int | None]:
    """Return what a chapter says at its head of what it needs and how long it takes to read.

    Parameters
    ----------
    chapter : Chapter
        The chapter.

    Returns
    -------
    need : str
        Empty if it does not say.
    minutes : int or None
        None if it does not say.
    """
    match = _HEAD.search(chapter.source.read_text(encoding="utf-8"))
    if match is None:
        return "", None
    return " ".join(match["need"].split()), int(match["minutes"])
