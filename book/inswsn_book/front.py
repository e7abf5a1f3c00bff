"""What the front page shows of the whole book: one picture, the verdicts, the way through."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import Any

from inswsn_book.about import ABOUT, load_about
from inswsn_book.project import Chapter, Project
from inswsn_book.results import Results
from inswsn_book.tables import list_table
from inswsn_book.verdicts import Judged, Verdict, count_verdicts
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

# the chapters whose results the picture draws
_DRAWN = {"00", "02", "03", "04", "05"}
_CAPTION = (
    "Left of the line the paper's method is better than its rival, right of it worse. On equal "
    "terms: both get the same measurements and the same tuning; P1's learners get the best input "
    "that exists in an outage. P3's method is a filter with aids and an LS-SVM, its rival KF has "
    "neither; the last row leaves the aids to both."
)
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
    """Return the comparisons that the papers are about.

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


def front_picture(rows: Sequence[Contest]) -> tuple[str, str]:
    """Draw the comparisons; return the SVG and its alternative text."""
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
    return _svg(fig), _alternative(rows)


def _svg(fig: Any) -> str:
    from matplotlib import pyplot as plt  # noqa: PLC0415

    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(fig)
    return stream.getvalue()


def _alternative(rows: Sequence[Contest]) -> str:
    parts = []
    for row in rows:
        values = {"printed": row.printed, "rebuilt": row.rebuilt, "recorded": row.recorded}
        said = ", ".join(f"{v:.2f} {name}" for name, v in values.items() if v is not None)
        parts.append(f"{' '.join(row.label.split())}: {said}")
    return (
        "A chart of the error of each paper's method over that of its rival, on a logarithmic "
        "scale with a line at 1. " + "; ".join(parts) + "."
    )


def front_texts(
    project: Project, results: Sequence[Results], judged: Sequence[Judged]
) -> dict[str, str]:
    """Return what the front page includes, by file name.

    The picture is left out while a chapter that it draws is not there; a front page that includes
    it then fails to build.

    Parameters
    ----------
    project : Project
        The checkout.
    results : sequence of Results
        Of the chapters that are shown.
    judged : sequence of Judged
        All claims.
    """
    by_chapter = {found.chapter: found for found in results}
    texts = {
        "front-verdicts.md": _verdicts(judged),
        "front-chapters.md": _chapters(project, by_chapter),
    }
    if by_chapter.keys() >= _DRAWN:
        svg, alt = front_picture(contests(project.root, by_chapter))
        texts["front.svg"] = svg
        # the path is read from the page that includes this
        # without a number, so that the chapters' figures begin with 1
        texts["front-picture.md"] = (
            f"```{{image}} generated/front.svg\n:alt: {alt}\n```\n\n"
            f":::{{div}} front-caption\n{_CAPTION}\n:::\n"
        )
    if (project.root / ABOUT).is_file():
        about = load_about(project.root)
        names = ", ".join(author.shown for author in about.authors)
        year = about.released[:4]
        texts["front-cite.md"] = f"{names} ({year}). *{about.title}*, version {about.version}.\n"
    return texts


def _verdicts(judged: Sequence[Judged]) -> str:
    counts = count_verdicts(judged)
    tested = {v: n for v, n in counts.items() if v.counts and v is not Verdict.UNTESTABLE}
    others = {v: n for v, n in counts.items() if v not in tested}
    return (
        f"**{len(judged)} claims**, of which {sum(tested.values())} are put to the test: "
        + ", ".join(f"**{n}** {v}" for v, n in tested.items())
        + ". The others: "
        + ", ".join(f"{n} {v}" for v, n in others.items())
        + ".\n"
    )


def _chapters(project: Project, results: Mapping[str, Results]) -> str:
    rows = [["no.", "chapter", "you need", "reading", "computing"]]
    for chapter in project.chapters():
        need, minutes = chapter_head(chapter)
        found = results.get(chapter.number)
        made = found.provenance if found else None
        rows.append(
            [
                chapter.number,
                f"{{doc}}`/chapters/{chapter.name}`",
                need or "–",
                f"{minutes} min" if minutes else "–",
                f"{made.seconds:.0f} s" if made else "–",
            ]
        )
    caption = "The chapters, what each asks of you, and how long each takes."
    spent = sum(r.provenance.seconds for r in results.values() if r.provenance) / 60
    return (
        list_table(caption, "tbl-chapters", rows)
        + f"\nAll chapters together took {spent:.0f} minutes of computing here.\n"
    )


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
