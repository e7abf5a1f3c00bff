"""The page of the build's state: how long each chapter ran, what it found, and on what machine."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from inswsn_book.results import Provenance, Results
from inswsn_book.tables import list_table
from inswsn_book.verdicts import Judged, Verdict

_HASH = 12  # digits of a commit that are shown
_SPACE = "\N{NO-BREAK SPACE}"  # between a number and its unit


def status_text(
    results: Sequence[Results], judged: Sequence[Judged], names: Mapping[str, str]
) -> str:
    """Return the tables of the page as MyST Markdown.

    Parameters
    ----------
    results : sequence of Results
        What each chapter recorded, in the order of the book.
    judged : sequence of Judged
        All claims with their verdicts.
    names : mapping of str to str
        The chapters' names by their numbers.
    """
    return "\n\n".join(
        [
            _runs(results, judged, names),
            _verdicts(results, judged),
            _machines(results),
        ]
    )


def _runs(results: Sequence[Results], judged: Sequence[Judged], names: Mapping[str, str]) -> str:
    decided = _decided(judged)
    header = ["chapter", "run time", "executed", "commit", "quantities", "sentences that hold"]
    rows = [[*header, "claims treated"]]
    for result in results:
        made = result.provenance
        rows.append(
            [
                f"{{doc}}`{result.chapter} <chapters/{names[result.chapter]}>`",
                "unknown" if made is None else f"{made.seconds:.1f}{_SPACE}s",
                "unknown" if made is None else made.finished,
                _commit(made),
                str(len(result.quantities)),
                f"{sum(result.sentences.values())} of {len(result.sentences)}",
                str(decided[result.chapter].total()),
            ]
        )
    known = [result.provenance.seconds for result in results if result.provenance is not None]
    sentences = [holds for result in results for holds in result.sentences.values()]
    rows.append(
        [
            "all",
            _duration(sum(known)),
            "",
            "",
            str(sum(len(result.quantities) for result in results)),
            f"{sum(sentences)} of {len(sentences)}",
            str(sum(decided[result.chapter].total() for result in results)),
        ]
    )
    return list_table(
        "The run of each chapter that this book shows.", "tbl-runs", rows, stub_columns=1
    )


def _verdicts(results: Sequence[Results], judged: Sequence[Judged]) -> str:
    decided = _decided(judged)
    chapters = [result.chapter for result in results if decided[result.chapter]]
    counts = {verdict: [decided[chapter][verdict] for chapter in chapters] for verdict in Verdict}
    nowhere = decided[None]
    rows = [["verdict", *chapters, "in no chapter", "all"]]
    for verdict, row in counts.items():
        cells = [*row, nowhere[verdict]]
        rows.append([str(verdict), *map(str, cells), str(sum(cells))])
    sums = [decided[chapter].total() for chapter in chapters]
    rows.append(["all", *map(str, sums), str(nowhere.total()), str(sum(sums) + nowhere.total())])
    return list_table(
        "Verdicts by the chapter that decides the claim.", "tbl-verdicts", rows, stub_columns=1
    )


def _decided(judged: Sequence[Judged]) -> dict[str | None, Counter[Verdict]]:
    """Count verdicts by the chapter that decides; a chapter that decides none counts nothing."""
    counts: dict[str | None, Counter[Verdict]] = _Counts()
    for entry in judged:
        counts[entry.claim.chapter][entry.verdict] += 1
    return counts


class _Counts(dict[str | None, Counter[Verdict]]):
    def __missing__(self, key: str | None) -> Counter[Verdict]:
        self[key] = Counter()
        return self[key]


def _machines(results: Sequence[Results]) -> str:
    """Return the machines, each with the chapters that ran there: commonly one for all."""
    rows = [["chapters", "machine", "linear algebra", "Python and packages"]]
    for chapters, made in _groups(results, _computed_with):
        packages = ", ".join(f"{name} {version}" for name, version in made.packages.items())
        rows.append(
            [
                ", ".join(chapters),
                f"{made.cpu}, {made.cores} cores, {made.system}",
                "; ".join(made.blas) or "unknown",
                f"Python {made.python}, {packages}",
            ]
        )
    return list_table("What the chapters were computed with.", "tbl-machines", rows, stub_columns=1)


def _computed_with(made: Provenance) -> tuple[object, ...]:
    packages = tuple(made.packages.items())
    return made.cpu, made.cores, made.system, made.blas, made.python, packages


def _groups(
    results: Sequence[Results], key: Callable[[Provenance], tuple[object, ...]]
) -> list[tuple[list[str], Provenance]]:
    groups: dict[tuple[object, ...], tuple[list[str], Provenance]] = {}
    for result in results:
        if result.provenance is not None:
            chapters, _ = groups.setdefault(key(result.provenance), ([], result.provenance))
            chapters.append(result.chapter)
    return list(groups.values())


def _commit(made: Provenance | None) -> str:
    if made is None or made.commit is None:
        return "unknown"
    return f"`{made.commit[:_HASH]}`" + ("" if made.clean else ", with changes")


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    parts = [f"{minutes}{_SPACE}min"] if minutes else []
    return _SPACE.join([*parts, f"{rest}{_SPACE}s"])
