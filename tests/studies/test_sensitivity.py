"""The stored sensitivity study: whole, consistent with the published results, and repeatable."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from hashlib import sha256

import pytest
from assumptions import Assumptions, load_assumptions
from effects import band_of
from inswsn_book import runs as engine
from inswsn_book.progress import Quiet
from inswsn_book.project import Project
from inswsn_book.results import Results, read_results
from sensitivity import FIGURE, cells_of, request_of, run_of, with_page
from study import BASELINE, SENSITIVITY, Study, read_study

QUICK = 60.0  # seconds that a run may have taken in the study
NOT_REDUCED = ("00", "01")  # chapters whose headlines have no chance in them


@pytest.fixture(scope="module")
def assumptions(project: Project) -> Assumptions:
    """The list of assumptions."""
    return load_assumptions(project.root)


@pytest.fixture(scope="module")
def study(project: Project) -> Study:
    """The stored study."""
    return read_study(project.root / SENSITIVITY)


@pytest.fixture(scope="module")
def published(project: Project) -> dict[str, Results]:
    """The published results, by chapter."""
    paths = sorted(project.published.glob("*.json"))
    return {path.stem: read_results(path) for path in paths}


def test_it_holds_every_run_and_no_other(assumptions: Assumptions, study: Study) -> None:
    wanted = {(cell.chapter, cell.id): cell for cell in cells_of(assumptions)}
    assert {(run.chapter, run.id) for run in study.runs} == set(wanted)
    for run in study.runs:
        assert run.parameters == wanted[run.chapter, run.id].parameters


def test_unchanged_runs_are_whole(assumptions: Assumptions, study: Study) -> None:
    for chapter in assumptions.reduced:
        for run in study.seeds(chapter):
            assert run.failed is None
            assert set(run.headlines) == {h.key for h in assumptions.of_chapter(chapter)}
            assert run.verdicts


def test_the_baseline_agrees_with_the_published_results(
    assumptions: Assumptions, study: Study, published: dict[str, Results]
) -> None:
    """Within what chance does to two runs of that size; exactly where there is no chance.

    One headline in ten may be outside of its band: each band holds with 95 %, and a few numbers,
    such as a least value over many, depend on the number of runs by themselves.
    """
    outside = []
    for headline in assumptions.headlines:
        baseline = study.run(headline.chapter, BASELINE)
        assert baseline is not None
        value, reference = (
            baseline.headlines[headline.key],
            headline.value(published[headline.chapter]),
        )
        if headline.chapter in NOT_REDUCED:
            assert value == pytest.approx(reference, rel=1e-4)
            continue
        band = band_of([run.headlines[headline.key] for run in study.seeds(headline.chapter)])
        if abs(value - reference) > band:
            outside.append(headline.key)
        assert value == pytest.approx(reference, rel=0.5)
        edge = headline.turns
        if edge is not None and abs(reference - edge) > band:
            assert (value - edge) * (reference - edge) > 0, f"{headline.key}: another conclusion"
    assert len(outside) <= len(assumptions.headlines) / 10, outside


def test_what_the_page_shows_is_of_these_runs_and_of_the_reference(
    project: Project, assumptions: Assumptions, study: Study
) -> None:
    """Otherwise: python studies/sensitivity.py --page."""
    now = with_page(project, assumptions, study).page
    assert rounded(now) == rounded(study.page)
    assert (project.root / FIGURE).is_file()


def rounded(value: object) -> object:
    """Return plain data with numbers as texts of six digits."""
    if isinstance(value, dict):
        return {key: rounded(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [rounded(inner) for inner in value]
    return f"{value:.6g}" if isinstance(value, float) else value


def test_percentages_by_plain_arithmetic(
    project: Project, assumptions: Assumptions, render: Callable[..., str]
) -> None:
    """From the JSON alone: each change that the page shows is after over before, less one."""
    text = render("assumptions").replace("\N{NO-BREAK SPACE}", " ")
    text = text.split("### Reruns\n")[1].split("### Verdicts\n")[0]
    runs = json.loads((project.root / SENSITIVITY).read_text())["runs"]
    before = {run["chapter"]: run["headlines"] for run in runs if run["id"] == "baseline"}
    alternatives = {
        f"{entry.id}/{other.id}": (f"assumption-{entry.id.lower()}", other.set)
        for entry in assumptions.assumptions
        for other in entry.alternatives
    }
    parts = text.split("{list-table} Chapter ")[1:]
    tables = {part[:2]: part.split(":::::")[0] for part in parts}
    compared = 0
    for run in runs:
        if run["id"] not in alternatives or run["failed"] is not None:
            continue
        anchor, set_ = alternatives[run["id"]]
        (row,) = (
            part
            for part in tables[run["chapter"]].split("* - ")
            if f"(#{anchor})\n  - {set_}\n" in part
        )
        cells = [line.strip("- ").replace("*", "") for line in row.splitlines()[2:]]
        keys = [headline.key for headline in assumptions.of_chapter(run["chapter"])]
        for key, cell in zip(keys, cells, strict=False):
            old, new = before[run["chapter"]][key], run["headlines"].get(key)
            if new is None or old <= 0 or new <= 0:
                continue
            shown = cell.replace(" ⇄", "").replace("\N{MINUS SIGN}", "-").replace(",", "")
            if shown.startswith("×"):
                assert float(shown[1:]) == pytest.approx(new / old, rel=0.05)
            else:
                assert float(shown.removesuffix("%")) == pytest.approx(
                    100 * (new / old - 1), abs=0.51
                )
            compared += 1
    assert compared > 100


@pytest.mark.whole
@pytest.mark.long
def test_one_run_comes_out_again(
    project: Project, assumptions: Assumptions, study: Study, published: dict[str, Results]
) -> None:
    """A run that the content of the stored file chooses, among the quick ones.

    It may be off by what a fresh build may be from the reference results, and by one in a thousand.
    """
    digest = sha256((project.root / SENSITIVITY).read_bytes()).hexdigest()
    quick = {(r.chapter, r.id) for r in study.runs if r.seconds < QUICK and r.failed is None}
    cells = [cell for cell in cells_of(assumptions) if (cell.chapter, cell.id) in quick]
    assert len(cells) > 5
    cell = random.Random(digest).choice(cells)
    stored = study.run(cell.chapter, cell.id)
    assert stored is not None
    done = engine.run(project, request_of(project, cell), Quiet(), fresh=True)
    again = run_of(project, cell, assumptions.of_chapter(cell.chapter), done)
    assert again.failed is None
    assert again.headlines.keys() == stored.headlines.keys()
    for headline in assumptions.of_chapter(cell.chapter):
        if headline.key in stored.headlines:
            tolerance = published[cell.chapter][headline.quantity].tolerance
            assert again.headlines[headline.key] == pytest.approx(
                stored.headlines[headline.key], rel=1e-3, abs=tolerance
            )
    # a claim that came after the study has no verdict in it
    assert stored.verdicts
    assert {name: again.verdicts[name] for name in stored.verdicts} == stored.verdicts
